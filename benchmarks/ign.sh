#!/usr/bin/env bash
# Airborne tiles: train on four of the six adjoining ign_770* tiles and two others, label the rest.
#
#   benchmarks/ign.sh ../shared/data/ign OUTPUT_FOLDER
#
# The six adjoin each other, so tiles judged here border on tiles trained on: the figures say how well
# a scan's neighbor is labelled, not how well another country is.
set -euo pipefail
data=$(realpath "$1")
settings=$(realpath "$(dirname "$0")/ign.toml")
mkdir -p "$2"
cd "$2"
train="77050_627755 77050_627760 77055_627755 77060_627760"
judge="77055_627760 77060_627755"
bushseg prepare $(printf "$data/ign_%s.laz " $train) "$data/origin_dsmMarker.laz" \
    "$data/patchwork_recipient.laz" --config "$settings"
bushseg train --run run --config "$settings"
for name in $judge; do
    bushseg predict "$data/ign_$name.laz" -o "$name.laz" --model run --overwrite
    bushseg evaluate "$name.laz" "$data/ign_$name.laz" --scheme asprs -o "report_$name"
done
