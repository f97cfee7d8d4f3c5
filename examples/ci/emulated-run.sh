#!/usr/bin/env bash
# A run against the emulated robot, as CI does it: no sleep, nothing left behind.
#   emulated-run.sh [FOLDER]      the log goes there, in place of an older one; default: the current
#                                 folder
set -euo pipefail
out="${1:-.}"
port="$(mktemp -u "${TMPDIR:-/tmp}/sweeper.XXXXXX")"
control="$port.ctl"

# `ready` is the first line on stdout: reading it is all the waiting there is.
exec 3< <(exec sweepctl emulate case-1 --seed 7 --pty-link "$port" --control "$control")
emulator=$!
trap 'kill "$emulator" 2>/dev/null || true' EXIT
read -r -t 60 word name <&3
[[ $word == ready && $name == "$port" ]]

# Six seconds with the robot, of which it stands for three. Status 0 means only that the run ended as
# asked, so check that the robot has driven without a fault.
sweepctl connect "$name" --plan paper --duration 6 --json --out "$out/run.mcap" --force >"$out/run.json"
python3 -c "import json, sys; s = json.load(open(sys.argv[1])); assert s['path_m'] > 0.1, s; assert not s['events']['device_faults'], s" "$out/run.json"

# Only the emulator knows the collisions.
sweepctl fault "$control" --truth --json >"$out/truth.json"
python3 -c "import json, sys; t = json.load(open(sys.argv[1]))['truth']; assert t['collisions'] == 0, t" "$out/truth.json"

# Ended in order: status 0, and the link is gone.
kill -TERM "$emulator"
wait "$emulator"
trap - EXIT
[[ ! -e $port && ! -L $port && ! -e $control ]]
echo "done: $out/run.mcap"
