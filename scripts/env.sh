# The environment of everything that runs here: `. scripts/env.sh` in a shell of your own, or
# `scripts/run COMMAND …` for one command. POSIX sh; the folder is $ATOR_ROS_ROOT where it is set.

if [ -z "${ATOR_ROS_ROOT:-}" ]; then
    if [ -n "${BASH_SOURCE:-}" ]; then
        ATOR_ROS_ROOT=$(cd "$(dirname "$BASH_SOURCE")/.." && pwd -P)
    elif [ -n "${ZSH_VERSION:-}" ]; then
        ATOR_ROS_ROOT=$(eval 'cd "${${(%):-%x}:h}/.." && pwd -P')
    else
        ATOR_ROS_ROOT=$(pwd -P)
    fi
fi
_venv=$ATOR_ROS_ROOT/.venv
_install=$ATOR_ROS_ROOT/install

if [ "$(cat "$_venv/ros_prefix" 2>/dev/null)" = wheels ]; then
    # ROS lives in the virtual environment: nothing of another ROS may shine through.
    export ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3 RMW_IMPLEMENTATION=rmw_fastrtps_cpp
    export AMENT_PREFIX_PATH=$_venv CMAKE_PREFIX_PATH=$_venv
    unset PYTHONPATH
    # The wheels extend LD_LIBRARY_PATH at the start of Python unless this is set (perhaps by another venv).
    unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
fi

_site=$(cd "$_venv/lib" 2>/dev/null && echo python3.*)
export VIRTUAL_ENV=$_venv
export PATH=$_venv/bin:$PATH
# DDS stays on this machine unless the user has said otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
export AMENT_PREFIX_PATH=$_install:$AMENT_PREFIX_PATH
export CMAKE_PREFIX_PATH=$_install${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}
export LD_LIBRARY_PATH=$_install/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
# build/ator_ros links to the sources: an edited Python file needs no build.
export PYTHONPATH=$ATOR_ROS_ROOT/build/ator_ros:$_install/lib/$_site/site-packages${PYTHONPATH:+:$PYTHONPATH}
unset _venv _install _site
