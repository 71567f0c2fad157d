# What a test needs, to be sourced. Missing programs are installed where apt-get needs no password, as ./gpugi installs a
# Vulkan driver (GPUGI_NO_INSTALL=1 forbids it); otherwise the test fails.

# need PACKAGE PROGRAM...: the path of the first of these programs that exists, or of what the package brings.
need() {
    local package=$1 sudo=
    shift
    command -v "$@" | head -n 1 | grep . && return
    [[ $(id -u) = 0 ]] || sudo='sudo -n'
    if [[ -z ${GPUGI_NO_INSTALL:-} ]] && command -v apt-get >/dev/null; then
        echo "$package is missing; installing it" >&2
        { $sudo apt-get update && DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y "$package"; } </dev/null >&2 || true
    fi
    command -v "$@" | head -n 1 | grep . || {
        echo "$1 is missing: install it, or leave the test out: $skip" >&2
        exit 1
    }
}

# need_modules FOLDER [PACKAGE...]: modules of npm in a folder, those of its package.json if none are named.
need_modules() {
    local folder=$1
    shift
    need npm npm >/dev/null
    (cd "$folder" && npm install --silent --no-audit --no-fund "$@") || {
        echo "npm could not install modules: it needs a network; or leave the test out: $skip" >&2
        exit 1
    }
}
