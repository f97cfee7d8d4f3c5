#!/usr/bin/env bash
# A run against the emulated robot, as CI does it: no sleep, nothing left behind.
#   emulated-run.sh [FOLDER]      the log goes there; default: the current folder
set -euo pipefail
out="${1:-.}"
port="$(mktemp -u "${TMPDIR:-/tmp}/sweeper.XXXXXX")"

# `ready` is the first line on stdout: reading it is all the waiting there is.
exec 3< <(exec sweepctl emulate case-1 --seed 7 --pty-link "$port")
emulator=$!
trap 'kill "$emulator" 2>/dev/null || true' EXIT
read -r word name <&3
[[ $word == ready && $name == "$port" ]]

# Four seconds with the robot; 0: ended as asked. Everything else fails this script.
sweepctl connect "$name" --plan paper --duration 4 --json --out "$out/run.mcap" >"$out/run.json"

# Ended in order: status 0, and the link is gone.
kill -TERM "$emulator"
wait "$emulator"
trap - EXIT
[[ ! -e $port && ! -L $port ]]
echo "done: $out/run.mcap"
