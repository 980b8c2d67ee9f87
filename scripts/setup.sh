# shellcheck shell=bash
# Sourced by scripts/run, scripts/test and scripts/check_core.sh: brings the virtual environment and OpenGL up.
# Functions only; nothing happens on sourcing but the settings below.

repo=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$repo/.venv
PATH=$PATH:/usr/local/sbin:/usr/sbin:/sbin        # apt and ldconfig live there; an empty environment lacks them
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore

mesa_packages="libegl1 libgl1 libgl1-mesa-dri"    # software OpenGL without a display
window_packages="xauth libegl1 libglib2.0-0 libdbus-1-3 libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4 libxcb-image0
    libxcb-keysyms1 libxcb-render-util0 libxcb-shape0 libxcb-xinerama0"   # what Qt's windows load
osmesa_packages="libosmesa6"                      # a second, independent path; only the tests need it

say() { printf 'splatgl: %s\n' "$*" >&2; }
die() { say "$*"; exit 1; }

# --- the state of the environment ---------------------------------------------------------------------------------

# What an environment was made from: the requirements, where the repository lies, and which Python is behind it.
# Shell and coreutils only, since this is all that a second start pays for.
fingerprint() {
    { cat "$repo/pyproject.toml" "$repo/constraints.txt" "$venv/pyvenv.cfg" 2>/dev/null || :
      printf '%s\n%s\n' "$repo" "$(readlink -f "$venv/bin/python")"; } | sha256sum
}

up_to_date() { # level
    [ -x "$venv/bin/python" ] && [ "$(cat "$venv/.splatgl-$1" 2>/dev/null)" = "$(fingerprint)" ]
}

# Bring the environment to a level, `run`, `test` or `all`; of two that start at once the second waits, then finds it
# done.
ensure() { # level
    if up_to_date "$1"; then return 0; fi
    exec 9<"$repo"
    if command -v flock >/dev/null; then flock -n 9 || { say "waiting for another set-up to finish"; flock 9; }; fi
    if ! up_to_date "$1"; then
        make_venv
        install_package "$1"
        ensure_opengl
        if [ "$1" != run ]; then ensure_osmesa; ensure_display; fi
        if [ "$1" = all ]; then ensure_peers; fi
        mark_done "$1"
    fi
    exec 9<&-
}

mark_done() { # level; each holds the levels before it
    local level
    for level in run test all; do
        fingerprint >"$venv/.splatgl-$level.$$"
        mv "$venv/.splatgl-$level.$$" "$venv/.splatgl-$level"
        if [ "$level" = "$1" ]; then break; fi
    done
}

# --- apt ----------------------------------------------------------------------------------------------------------

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

may_apt() {
    command -v apt-get >/dev/null && { [ "$(id -u)" = 0 ] || { command -v sudo && sudo -n true; } >/dev/null 2>&1; }
}

apt_install() { # packages…; false where this user may not or apt could not
    if ! may_apt; then return 1; fi
    say "installing with apt: $*"
    as_root apt-get update -qq >&2 || say "apt-get update failed; trying with the package lists that are here"
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends --no-upgrade \
        -o DPkg::Lock::Timeout=300 -o Dpkg::Use-Pty=0 "$@" >/dev/null
}

# --- Python -------------------------------------------------------------------------------------------------------

new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

find_python() { # prints the first Python that is new enough
    local name
    for name in python3 python3.14 python3.13 python3.12 python3.11; do
        if command -v "$name" >/dev/null && new_enough "$name"; then command -v "$name"; return 0; fi
    done
    return 1
}

need_python() { # prints a Python ≥ 3.11, from apt where the system's own is older
    if find_python; then return 0; fi
    apt_install python3.11 python3.11-venv || true
    find_python || die "Python: expected 3.11 or newer, got $(python3 -V 2>&1); install it with:" \
        "sudo apt-get install python3.11 python3.11-venv"
}

make_venv() { # keeps an environment that works, whoever made it
    if [ -x "$venv/bin/python" ] && new_enough "$venv/bin/python" && "$venv/bin/python" -m pip --version >/dev/null 2>&1
    then return 0; fi
    local python package
    python=$(need_python) || exit 1
    # Debian and Ubuntu keep ensurepip, without which there is no venv, in a package of its own
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        package=python$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv
        apt_install "$package" || apt_install python3-venv ||
            die "$python has no venv module; install it with: sudo apt-get install $package"
    fi
    say "making a virtual environment in $venv"
    "$python" -m venv --clear "$venv"
    # those that Python 3.11 and 3.12 come with take twice as long to find versions
    pip_install "pip>=25" || say "pip: the newest could not be installed; going on with $("$venv/bin/python" -m pip -V)"
}

install_package() { # level
    local extras=all
    if [ "$1" = test ]; then extras=all,dev; fi
    if [ "$1" = all ]; then extras=all,dev,peers; fi
    say "installing splatgl[$extras] into $venv (needed once; about a minute)"
    pip_install -c "$repo/constraints.txt" -e "${repo}[$extras]" && return 0
    # A pinned version may have no wheel for this Python; the ranges in pyproject.toml still hold
    say "the versions in constraints.txt could not be installed; trying the newest that pyproject.toml allows"
    pip_install -e "${repo}[$extras]" || die "pip could not install the packages; see its message above"
}

# what is imported is compiled then: of most packages that is little, and compiling all takes longer than unpacking
pip_install() { "$venv/bin/python" -m pip install --quiet --no-compile "$@" >&2; }

# --- OpenGL -------------------------------------------------------------------------------------------------------

# Prints the renderer if a context opens without a display; else says why and returns 3.
probe() { # backend
    "$venv/bin/python" -c '
import sys
from splatgl.errors import InputError
from splatgl.gl.context import context_info, open_context
from splatgl.opengl import OpenGL
try:
    info = context_info(open_context(OpenGL(sys.argv[1])))
except InputError as error:
    print(error)
    sys.exit(3)
print("software" if info.software else "hardware", info.renderer)' "$1"
}

# Mesa's software renderer, only where no driver answers. Set-up goes on without: OSMesa or a window may still serve,
# and the command itself says what it found.
ensure_opengl() {
    local answer status=0
    answer=$(probe egl) || status=$?
    if [ $status = 0 ]; then say "OpenGL: $answer"; return 0; fi
    [ $status = 3 ] || die "the check for OpenGL itself failed"
    say "EGL does not work here. $answer"
    # shellcheck disable=SC2086
    if ! apt_install $mesa_packages; then return 0; fi  # the line above says what to install
    answer=$(probe egl) || true
    say "OpenGL: $answer"
}

ensure_osmesa() { # for the tests only; never at the price of a package that a graphics card depends on
    if probe osmesa >/dev/null; then return 0; fi
    local hint="the tests that need OSMesa are skipped; to run them: sudo apt-get install $osmesa_packages"
    if ! may_apt; then say "$hint"; return 0; fi
    if [ "$(probe egl | cut -d' ' -f1)" = hardware ] && disturbs_others $osmesa_packages; then
        say "installing $osmesa_packages would change the driver packages of a graphics card; $hint"; return 0
    fi
    apt_install $osmesa_packages || say "$hint"
}

ensure_display() { # for the tests only: a display that is not there, and keys and a mouse for it
    if command -v Xvfb >/dev/null && command -v xdotool >/dev/null; then return 0; fi
    apt_install xvfb xdotool ||
        say "the tests of the window are skipped; to run them: sudo apt-get install xvfb xdotool"
}

ensure_peers() { # for the long tests only: libraries of Qt's windows, a browser, and the reference compiler of GLSL
    if ! command -v glslangValidator >/dev/null; then
        apt_install glslang-tools ||
            say "the tests by the reference compiler are skipped; to run them: sudo apt-get install glslang-tools"
    fi
    if ! command -v xauth >/dev/null || lacks_libraries libxcb-cursor libxcb-icccm libxcb-keysyms libxcb-render-util; then
        # shellcheck disable=SC2086
        apt_install $window_packages ||
            say "the tests in napari's window are skipped; to run them: sudo apt-get install $window_packages"
    fi
    if ! command -v chromium >/dev/null && ! command -v google-chrome >/dev/null; then
        apt_install chromium || say "the tests in a browser are skipped; to run them: sudo apt-get install chromium"
    fi
}

lacks_libraries() { # names; true if the system lacks one of them
    local name known
    known=$(ldconfig -p)
    for name in "$@"; do [[ $known == *"$name.so"* ]] || return 0; done
    return 1
}

disturbs_others() { # packages…; true if apt would upgrade or remove what is installed
    apt-get -s --no-install-recommends install "$@" 2>/dev/null | grep -Eq '^(Remv|Inst [^ ]+ \[)'
}
