# What a test needs, to be sourced; `skip` says how to leave the test out. Missing programs are installed where apt-get
# needs no password, as ./gpugi installs a Vulkan driver (GPUGI_NO_INSTALL=1 forbids it); otherwise the test fails.

first_of() {
    local program
    for program; do
        command -v "$program" && return
    done
    return 1
}

# need PACKAGE PROGRAM...: the path of the first of these programs that exists, or of what the package brings.
need() {
    local package=$1 sudo=
    shift
    first_of "$@" && return
    [[ $(id -u) = 0 ]] || sudo='sudo -n'
    if [[ -z ${GPUGI_NO_INSTALL:-} ]] && command -v apt-get >/dev/null; then
        echo "$package is missing; installing it" >&2
        { $sudo apt-get update; DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y "$package"; } </dev/null >&2 || true
    fi
    first_of "$@" || {
        echo "$1 is missing: install it, or leave the test out: $skip" >&2
        exit 1
    }
}

# need_modules FOLDER [PACKAGE...]: modules of npm in a folder, those of its package.json if none are named.
need_modules() {
    local folder=$1
    shift
    need npm npm >/dev/null
    npm install --silent --no-audit --no-fund --prefix "$folder" "$@" || {
        echo "npm could not install modules: it needs a network; or leave the test out: $skip" >&2
        exit 1
    }
}
