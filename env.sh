# Source this:  . ./env.sh      Puts waam, the nodes and the Python of the workspace on the path of this shell.
_waam_root=$(cd "$(dirname "${BASH_SOURCE[0]:-$0}")" && pwd)
if [ ! -f "$_waam_root/waam_ws/install/env.sh" ]; then
    echo "the workspace is not built yet: run 'make setup' in $_waam_root" >&2
    return 1 2>/dev/null || exit 1
fi
. "$_waam_root/waam_ws/install/env.sh"
# Its paths take the place of those that the wheels of ROS have found for a Python program that calls waam: anew, then.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
case ":$PATH:" in *":$_waam_root/.venv/bin:"*) ;; *) PATH=$_waam_root:$_waam_root/.venv/bin:$PATH ;; esac
export PATH WAAM_ROOT=$_waam_root
# Containers set it; every node would then compile all that it imports at every start: 7 s of a core instead of 2.
unset PYTHONDONTWRITEBYTECODE
export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}   # an open cell is a safety hole
export RCUTILS_COLORIZED_OUTPUT=${RCUTILS_COLORIZED_OUTPUT:-0}
_waam_dds=$_waam_root/waam_ws/src/waam_bringup/config/fastdds.xml
[ -f "$_waam_dds" ] && export FASTRTPS_DEFAULT_PROFILES_FILE=${FASTRTPS_DEFAULT_PROFILES_FILE:-$_waam_dds}
unset _waam_root _waam_dds
