#!/bin/sh
# Forward one event of sweepctl to an MQTT broker, and its text to a phone.
# sweepctl passes the event as JSON on the standard input; see docs/events.md.
set -eu
MQTT_HOST="${MQTT_HOST:-localhost}"
NTFY_TOPIC="${NTFY_TOPIC:-}"

mosquitto_pub -h "$MQTT_HOST" -t "sweepctl/$SWEEPCTL_EVENT" -q 1 -s
if [ -n "$NTFY_TOPIC" ]; then
    curl --silent --show-error --fail --max-time 5 \
        -H "Title: Robot: $SWEEPCTL_EVENT" -d "$SWEEPCTL_TEXT" "https://ntfy.sh/$NTFY_TOPIC"
fi
