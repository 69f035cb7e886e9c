#!/bin/sh
# The gate's cases at reduced length on an emulated arm64 processor, bit for bit beside this one (`make test-arm64`).
# On Debian and Ubuntu as root: installs qemu-user, unpacks an arm64 Python of the same version and the locked wheels.
set -eu
cd "$(dirname "$0")/../.."
place=$PWD/.venv/arm64
own=$(.venv/bin/python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
python="python$own"
fail() { echo "error: $*" >&2; exit 2; }

test "$(uname -m)" = x86_64 || fail "this compares arm64 with x86-64 (this machine: $(uname -m))"
if ! command -v qemu-aarch64 >/dev/null || ! test -e "$place/root/.ready"; then
	test "$(id -u)" = 0 && command -v apt-get >/dev/null || fail "qemu-user and an arm64 Python are installed with apt, as root"
	dpkg --add-architecture arm64
	apt-get update -qq
	apt-get install -y -qq --no-install-recommends qemu-user >&2
	rm -rf "$place/debs" "$place/root"
	mkdir -p "$place/debs" "$place/root"
	# what Python and the wheels load, each with what it depends on
	names=$(apt-cache depends --recurse --no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces \
		--no-enhances "$python-minimal:arm64" "lib$python-stdlib:arm64" libstdc++6:arm64 | grep '^[a-z].*:arm64$' | sort -u)
	test -n "$names" || fail "apt has no $python for arm64: make .venv with the system's own Python"
	(cd "$place/debs" && apt-get download -qq $names) || fail "the arm64 packages could not be fetched"
	for deb in "$place"/debs/*.deb; do dpkg -x "$deb" "$place/root"; done
	touch "$place/root/.ready"
fi
# pip takes the markers of a requirement from the machine it runs on: scikit-sundae, without a wheel there, goes here
awk '/^[A-Za-z0-9]/ { keep = !/^scikit-sundae==/ } keep' requirements.lock >"$place/requirements.lock"
if ! cmp -s "$place/requirements.lock" "$place/site.lock"; then
	rm -rf "$place/site"
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --only-binary=:all: --python-version "$own" \
		--platform manylinux2014_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux_2_28_aarch64 \
		--target "$place/site" -r "$place/requirements.lock" || fail "a locked package has no wheel for Linux on arm64"
	ln -sfn "$PWD" "$place/site/mbsbench"
	cp "$place/requirements.lock" "$place/site.lock"
fi
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONNOUSERSITE=1
.venv/bin/python tests/emulation/gate_cases.py run "$place/here.json"
PYTHONPATH="$place/site" qemu-aarch64 -L "$place/root" "$place/root/usr/bin/$python" \
	tests/emulation/gate_cases.py run "$place/there.json" "${SECONDS_OF_CPU:-1500}"
.venv/bin/python tests/emulation/gate_cases.py compare "$place/here.json" "$place/there.json"
