#!/bin/sh
# The gate's cases at reduced length on an emulated arm64 processor, bit for bit beside this one (`make test-arm64`).
# On Debian and Ubuntu: installs qemu-user (as root), unpacks an arm64 Python of the same version and the locked wheels.
set -eu
cd "$(dirname "$0")/../.."
place=$PWD/.venv/arm64
own=$(.venv/bin/python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
python="python$own"
fail() { echo "error: $*" >&2; exit 2; }

test "$(uname -m)" = x86_64 || fail "this compares arm64 with x86-64 (this machine: $(uname -m))"
echo "arm64: packages of another architecture go to $place; this system's dpkg does not learn of them" >&2
if ! command -v qemu-aarch64 >/dev/null; then
	test "$(id -u)" = 0 && command -v apt-get >/dev/null || fail "qemu-user is missing, which is installed with apt, as root"
	apt-get update -qq
	apt-get install -y -qq --no-install-recommends qemu-user >&2
fi
if ! test -e "$place/root/.ready"; then
	command -v apt-get >/dev/null || fail "an arm64 Python is fetched with apt-get, which is missing"
	rm -rf "$place/apt" "$place/debs" "$place/root"
	mkdir -p "$place/apt/lists/partial" "$place/apt/archives/partial" "$place/debs" "$place/root"
	: >"$place/apt/status"
	# an apt of arm64, with the sources of this system and nothing installed
	printf '%s;\n' 'APT::Architecture "arm64"' 'APT::Architectures { "arm64" }' "Dir::State \"$place/apt\"" \
		"Dir::State::status \"$place/apt/status\"" "Dir::Cache \"$place/apt\"" >"$place/apt/conf"
	export APT_CONFIG="$place/apt/conf"
	apt-get update -qq
	# what Python and the wheels load, each with the libraries it depends on
	names=$(apt-cache depends --recurse --no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces \
		--no-enhances "$python-minimal" "lib$python-stdlib" libstdc++6 | grep -E '^(lib|python|zlib)' | grep -v : | sort -u)
	test -n "$names" || fail "apt has no $python for arm64: make .venv with the system's own Python"
	(cd "$place/debs" && apt-get download -qq $names) || fail "the arm64 packages could not be fetched"
	unset APT_CONFIG
	for deb in "$place"/debs/*.deb; do dpkg -x "$deb" "$place/root"; done
	rm -rf "$place/apt" "$place/debs"
	touch "$place/root/.ready"
fi
# pip takes the markers of a requirement from the machine it runs on: scikit-sundae, without a wheel there, goes here
awk '/^[A-Za-z0-9]/ { keep = !/^scikit-sundae==/ } keep' locks/requirements.lock >"$place/requirements.lock"
if ! cmp -s "$place/requirements.lock" "$place/site.lock"; then
	rm -rf "$place/site"
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --only-binary=:all: --python-version "$own" \
		--platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux_2_28_aarch64 \
		--target "$place/site" -r "$place/requirements.lock" || fail "a locked package has no wheel for Linux on arm64"
	ln -sfn "$PWD" "$place/site/mbsbench"
	cp "$place/requirements.lock" "$place/site.lock"
fi
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONNOUSERSITE=1
.venv/bin/python -m mbsbench.tests.processors.compare_bits --suites ci --budget "${SECONDS_OF_CPU:-1500}" \
	${SOLVERS:+--solvers $SOLVERS} --there env PYTHONPATH="$place/site" \
	qemu-aarch64 -L "$place/root" "$place/root/usr/bin/$python"
