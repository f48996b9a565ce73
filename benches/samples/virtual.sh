#!/usr/bin/env bash
# Makes the sample rig of a release: a small virtual scanner with ground truth, packed. nelu3d must be in the PATH.
set -euo pipefail
out=${1:-nelu3d-sample-rig.tar.gz}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
nelu3d simulate demo -o "$folder/nelu3d-sample-rig" --quiet
# Sorted, without owners and dates: the same program makes the same archive.
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime=@0 -C "$folder" -c nelu3d-sample-rig | gzip -9n > "$out"
ls -l "$out"
