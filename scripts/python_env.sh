# An environment of Python under CALIB_TOOLS (target/tools otherwise) for the wheel of scripts/python_wheel.sh. Sourced with its name:
#
#   . "$(dirname "$0")/python_env.sh" ray
#
# It sets `root`, `tools`, `wheel`, `python` of the environment, and `work`, an empty folder that goes when the script ends.
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
tools=$(realpath "${CALIB_TOOLS:-$root/target/tools}")
wheel=$(echo "$tools"/dist/calib_rl-*.whl)
test -f "$wheel" || { echo "$(basename "$0"): there is no wheel in $tools/dist; run scripts/python_wheel.sh" >&2; exit 2; }
python=$tools/$1/bin/python
[ -x "$python" ] || python3 -m venv "$tools/$1"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
