# The environment for all commands: `. scripts/env.sh` in a shell, or `scripts/run COMMAND …` for
# one command.
# POSIX sh. The checkout that is sourced last replaces any other.

_former=${ATOR_ROS_ROOT:-}
if [ -n "${_ator_ros_root:-}" ]; then # set by scripts/run
    ATOR_ROS_ROOT=$_ator_ros_root
elif [ -n "${BASH_VERSION:-}" ]; then
    ATOR_ROS_ROOT=$(cd "$(dirname "$BASH_SOURCE")/.." && pwd -P)
elif [ -n "${ZSH_VERSION:-}" ]; then
    ATOR_ROS_ROOT=$(eval 'cd "${${(%):-%x}:h}/.." && pwd -P')
else
    # Other shells have no variable for a sourced file, but keep it open. ($$ is wrong in a
    # subshell.)
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

# Print the list of folders $1 without folders of this checkout and of the one sourced before,
# without empty entries, and without folders for which the command $2 succeeds.
_others() {
    _rest=$1:
    _kept=
    while [ -n "$_rest" ]; do
        _entry=${_rest%%:*}
        _rest=${_rest#*:}
        case $_entry in
        '') continue ;;
        "$ATOR_ROS_ROOT"/.venv* | "$ATOR_ROS_ROOT"/install* | "$ATOR_ROS_ROOT"/build*) continue ;;
        "${_former:-/none}"/.venv* | "${_former:-/none}"/install* | "${_former:-/none}"/build*) continue ;;
        esac
        "$2" "$_entry" || _kept=${_kept:+$_kept:}$_entry
    done
    printf %s "$_kept"
}

# Succeed if the folder $1 is, or is in, a ROS installation: /opt/ros, or a prefix with rclpy.
_in_ros() {
    _folder=$1
    while :; do
        case $_folder in /opt/ros/*) return 0 ;; /*) ;; *) return 1 ;; esac
        [ -d "$_folder/share/rclpy" ] && return 0
        _folder=${_folder%/*}
    done
}

# Succeed if the folder $1 is in none of the workspaces whose prefixes are on AMENT_PREFIX_PATH.
_in_no_workspace() {
    _prefixes=$AMENT_PREFIX_PATH
    while [ -n "$_prefixes" ]; do
        _prefix=${_prefixes%%:*}
        case $1 in "${_prefix%/install*}"/*) return 1 ;; esac
        _prefixes=${_prefixes#"$_prefix"}
        _prefixes=${_prefixes#:}
    done
    return 0
}

# With ROS in the virtual environment, another ROS is removed. Sourced workspaces are kept, after
# this one. Of PYTHONPATH only workspaces are kept, because it precedes the packages of the virtual
# environment.
_ros=$(cat "$_venv/ros_prefix" 2>/dev/null)
_foreign=false
_outside=false
if [ "$_ros" = wheels ]; then
    _foreign=_in_ros
    _outside=_in_no_workspace
fi
PATH=$(_others "$PATH" false)
AMENT_PREFIX_PATH=$(_others "${AMENT_PREFIX_PATH:-}" "$_foreign")
CMAKE_PREFIX_PATH=$(_others "${CMAKE_PREFIX_PATH:-}" "$_foreign")
LD_LIBRARY_PATH=$(_others "${LD_LIBRARY_PATH:-}" "$_foreign")
PYTHONPATH=$(_others "${PYTHONPATH:-}" "$_outside")
if [ "$_ros" = wheels ]; then
    export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3 RMW_IMPLEMENTATION=rmw_fastrtps_cpp
    AMENT_PREFIX_PATH=$_venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}
    CMAKE_PREFIX_PATH=$_venv${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}
    # The wheels extend LD_LIBRARY_PATH at the start of Python unless this is set (perhaps by
    # another venv).
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
fi

_site=$(cd "$_venv/lib" 2>/dev/null && echo python3.*)
export VIRTUAL_ENV="$_venv"
export PATH="$_venv/bin:$PATH"
# By default, DDS stays on this machine.
export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
export AMENT_PREFIX_PATH="$_install${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}"
export CMAKE_PREFIX_PATH="$_install${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}"
export LD_LIBRARY_PATH="$_install/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
# build/ator_ros links to the sources: an edited Python file needs no build.
export PYTHONPATH="$ATOR_ROS_ROOT/build/ator_ros:$_install/lib/$_site/site-packages${PYTHONPATH:+:$PYTHONPATH}"
unset _former _shell _file _venv _install _site _rest _kept _entry _folder _prefix _prefixes _ros _foreign _outside
unset -f _others _in_ros _in_no_workspace
