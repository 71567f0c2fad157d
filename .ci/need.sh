# Sourced by tests: makes sure of the programs that they need.

# need PROGRAM PACKAGE: installs the package (Debian, Ubuntu) if the program is missing, or fails.
need() {
    command -v "$1" >/dev/null && return
    local sudo=
    [[ $EUID = 0 ]] || sudo='sudo -n'
    echo "installing $2, for $1"
    if ! { command -v apt-get && $sudo apt-get update && DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y "$2"; } &>"$scratch/apt.log"; then
        tail -n 5 "$scratch/apt.log" >&2
        echo "$1 is missing, and its package $2 cannot be installed" >&2
        return 1
    fi
}

# The path of Chromium, under whichever name it goes, in `chromium`.
need_chromium() {
    chromium=$(command -v chromium || command -v chromium-browser || command -v google-chrome) && return
    need chromium chromium
    chromium=$(command -v chromium)
}
