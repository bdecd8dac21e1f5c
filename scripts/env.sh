# The environment of everything that runs here: `. scripts/env.sh` in a shell of your own, or
# `scripts/run COMMAND …` for one command. POSIX sh. The checkout that is sourced last replaces any other.

_former=${ATOR_ROS_ROOT:-}
if [ -n "${_ator_ros_root:-}" ]; then # scripts/run knows it
    ATOR_ROS_ROOT=$_ator_ros_root
elif [ -n "${BASH_VERSION:-}" ]; then
    ATOR_ROS_ROOT=$(cd "$(dirname "$BASH_SOURCE")/.." && pwd -P)
elif [ -n "${ZSH_VERSION:-}" ]; then
    ATOR_ROS_ROOT=$(eval 'cd "${${(%):-%x}:h}/.." && pwd -P')
else
    # Other shells do not tell where a sourced file lies, but they hold it open. ($$ would miss a subshell.)
    _shell=$(exec sh -c 'echo "$PPID"')
    for _file in /proc/"$_shell"/fd/*; do
        _file=$(readlink "$_file")
        case $_file in
        */scripts/env.sh) ATOR_ROS_ROOT=${_file%/scripts/env.sh} ;;
        esac
    done
fi
export ATOR_ROS_ROOT
_venv=$ATOR_ROS_ROOT/.venv
_install=$ATOR_ROS_ROOT/install

# Print the list of folders $1 without those of the checkout that was sourced before, and without empty entries.
_others() {
    _rest=$1:
    _kept=
    while [ -n "$_rest" ]; do
        _entry=${_rest%%:*}
        _rest=${_rest#*:}
        case $_entry in
        '') ;;
        "${_former:-/none}"/*) ;;
        *) _kept=${_kept:+$_kept:}$_entry ;;
        esac
    done
    printf %s "$_kept"
}

PATH=$(_others "$PATH")
AMENT_PREFIX_PATH=$(_others "${AMENT_PREFIX_PATH:-}")
CMAKE_PREFIX_PATH=$(_others "${CMAKE_PREFIX_PATH:-}")
LD_LIBRARY_PATH=$(_others "${LD_LIBRARY_PATH:-}")
PYTHONPATH=$(_others "${PYTHONPATH:-}")

if [ "$(cat "$_venv/ros_prefix" 2>/dev/null)" = wheels ]; then
    # ROS lives in the virtual environment: nothing of another ROS may shine through.
    export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3 RMW_IMPLEMENTATION=rmw_fastrtps_cpp
    AMENT_PREFIX_PATH=$_venv CMAKE_PREFIX_PATH=$_venv PYTHONPATH=
    # The wheels extend LD_LIBRARY_PATH at the start of Python unless this is set (perhaps by another venv).
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
fi

_site=$(cd "$_venv/lib" 2>/dev/null && echo python3.*)
export VIRTUAL_ENV="$_venv"
export PATH="$_venv/bin:$PATH"
# DDS stays on this machine unless the user has said otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
export AMENT_PREFIX_PATH="$_install${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}"
export CMAKE_PREFIX_PATH="$_install${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}"
export LD_LIBRARY_PATH="$_install/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
# build/ator_ros links to the sources: an edited Python file needs no build.
export PYTHONPATH="$ATOR_ROS_ROOT/build/ator_ros:$_install/lib/$_site/site-packages${PYTHONPATH:+:$PYTHONPATH}"
unset _former _shell _file _venv _install _site _rest _kept _entry
unset -f _others
