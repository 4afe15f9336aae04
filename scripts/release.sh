#!/usr/bin/env bash
# What is handed to others, in DIRECTORY (default: dist): a static binary for Linux in a .tar.gz with man pages, completions and JSON Schemas, a Debian package, the
# wheel, what is in it (SBOM, CycloneDX) and checksums. What is made is tried: installed into an empty root, and run there without an
# environment.
#
#     bash scripts/release.sh [DIRECTORY]
#     CALIB_BINARY=FILE bash scripts/release.sh      # of a static binary that is there
#     CALIB_RELEASE=quick bash scripts/release.sh    # no wheel, and no quickstart
#
# The binary is linked with a static glibc (Debian: libc6-dev): the objects are those of `cargo build --release`, and only the last step differs. musl
# would want every dependency compiled again, and its allocator is slow where many threads allocate.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-dist}
quick=${CALIB_RELEASE:-}
mkdir -p "$out"
out=$(cd "$out" && pwd)
if [ -n "$(ls -A "$out")" ]; then
    echo "release.sh: $out is not empty; name another folder, or empty it: what lies there would be released as well" >&2
    exit 1
fi
if ! git diff --quiet HEAD; then
    echo "release.sh: there are changes that no commit has; commit them, or put them aside" >&2
    exit 1
fi
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
# As Debian calls it.
architecture=$(dpkg --print-architecture)
# The same commit gives the same archives.
when=$(git log -1 --format=%ct)
export CALIB_COMMIT=${CALIB_COMMIT:-$(git rev-parse --short HEAD)}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

echo "== binary"
target=${CARGO_TARGET_DIR:-target}
calib=$work/calib
if [ -z "${CALIB_BINARY:-}" ]; then
    cargo rustc --release --locked --bin calib -- -C target-feature=+crt-static
    CALIB_BINARY=$target/release/calib
fi
share=$work/share
cargo run --quiet --release --locked --example json_schemas -- "$share/json"
install -m 755 "$CALIB_BINARY" "$calib"
strip "$calib"
# Only now: packages that look at it would be compiled again.
export SOURCE_DATE_EPOCH=$when
if ldd "$calib" 2>&1 | grep -q '=>'; then
    echo "release.sh: the binary is not static:" >&2
    ldd "$calib" >&2
    exit 1
fi

echo "== man pages, completions, SBOM"
mkdir -p "$share/man/man1" "$share/completions"
"$calib" -q man "$share/man/man1"
for shell in bash zsh fish; do
    "$calib" completions "$shell" > "$share/completions/calib.$shell"
done
python3 scripts/sbom.py > "$out/calib-$version.cdx.json"

echo "== archive"
name=calib-$version-linux-$(uname -m)
mkdir "$work/$name"
cp -r "$calib" "$share/man" "$share/completions" "$share/json" README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT "$work/$name"
# What the figures are written in.
cp crates/calib-report/assets/fonts/LICENSE "$work/$name/LICENSE-FONTS"
tar --mode=u=rwX,go=rX --sort=name --mtime="@$when" --owner=0 --group=0 --numeric-owner -C "$work" -c "$name" | gzip -9n > "$out/$name.tar.gz"

echo "== Debian package"
package=$work/package
install -D -m 755 "$calib" "$package/usr/bin/calib"
for page in "$share/man/man1"/*.1; do
    install -D -m 644 "$page" "$package/usr/share/man/man1/$(basename "$page")"
done
gzip -9n "$package/usr/share/man/man1"/*.1
install -D -m 644 "$share/completions/calib.bash" "$package/usr/share/bash-completion/completions/calib"
install -D -m 644 "$share/completions/calib.zsh" "$package/usr/share/zsh/vendor-completions/_calib"
install -D -m 644 "$share/completions/calib.fish" "$package/usr/share/fish/vendor_completions.d/calib.fish"
mkdir -p "$package/usr/share/doc/calib-rl" "$package/DEBIAN"
cat LICENSE-MIT LICENSE-APACHE crates/calib-report/assets/fonts/LICENSE > "$package/usr/share/doc/calib-rl/copyright"
gzip -9nc CHANGELOG.md > "$package/usr/share/doc/calib-rl/changelog.gz"
cat > "$package/DEBIAN/control" <<END
Package: calib-rl
Version: $version
Architecture: $architecture
Maintainer: The calib developers <calib@localhost>
Section: science
Priority: optional
Installed-Size: $(du -sk "$package/usr" | cut -f1)
Homepage: $(sed -n 's/^repository = "\(.*\)"/\1/p' Cargo.toml)
Description: hyperparameters of an online learner, from a plant's logs
 calib turns sensor logs into calibration models, trains prediction agents inside
 them over a sweep of hyperparameters, and says which to deploy.
END
chmod -R u=rwX,go=rX "$package"
dpkg-deb --root-owner-group -Zxz --build "$package" "$out/calib-rl_${version}_$architecture.deb" >/dev/null

if [ "$quick" != quick ]; then
    echo "== wheel"
    bash scripts/python_wheel.sh
    cp "${CALIB_TOOLS:-target/tools}"/dist/*-"$version"-*.whl "$out"
fi

echo "== checksums"
(cd "$out" && rm -f SHA256SUMS && sha256sum -- * > "$work/sums" && mv "$work/sums" SHA256SUMS)

echo "== installed into an empty root"
root=$work/root
mkdir -p "$root/var/lib/dpkg"/{info,updates,triggers}
: > "$root/var/lib/dpkg/status"
dpkg --root="$root" --force-not-root --force-bad-path --log=/dev/null -i "$out/calib-rl_${version}_$architecture.deb" >/dev/null
case $(env -i "$root/usr/bin/calib" --version) in
    "calib $version ("*) ;;
    *) exit 1 ;;
esac
man_pages=("$root"/usr/share/man/man1/calib*.1.gz)
test "${#man_pages[@]}" -gt 10
dpkg --root="$root" --force-not-root --force-bad-path --log=/dev/null -r calib-rl >/dev/null
test ! -e "$root/usr/bin/calib"
tar -xzf "$out/$name.tar.gz" -C "$work/root"
if [ "$quick" != quick ]; then
    (cd "$work" && env -i "$work/root/$name/calib" -q quickstart tried)
    test -s "$work/tried/results/report.html"
fi
(cd "$out" && sha256sum --check --quiet SHA256SUMS)
ls -l "$out"
