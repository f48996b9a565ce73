#!/bin/sh
# Pictures of pages as a phone and as a desk show them: screenshots.sh OUT_DIR PAGE.html...
# Needs Chromium (Debian: apt-get install chromium), or another of its kind named in CHROMIUM.
set -eu
chromium=${CHROMIUM:-chromium}
out=${1:?usage: screenshots.sh OUT_DIR PAGE.html...}
shift
mkdir -p "$out"
for page in "$@"; do
    path=$(realpath "$page")
    name=$(basename "$(dirname "$path")")-$(basename "$path" .html)
    for size in 390,3000 1280,2400; do
        profile=$(mktemp -d)
        picture="$out/$name-${size%,*}.png"
        "$chromium" --headless --no-sandbox --disable-gpu --enable-unsafe-swiftshader --disable-quic --no-first-run \
            --disable-background-networking --disable-component-update --disable-sync --hide-scrollbars \
            --user-data-dir="$profile" --virtual-time-budget=5000 --window-size="$size" --screenshot="$picture" \
            "file://$path" 2>/dev/null
        rm -rf "$profile"
        echo "$picture"
    done
done
