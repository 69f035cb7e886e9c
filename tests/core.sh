#!/bin/sh
# Whether the core is whole without lab, formats and engines (`make core`): in a copy they are deleted, with the commands,
# drawings and tests that go with them, and what is left is set up, tested, gated and benched.
set -eu
cd "$(dirname "$0")/.."
copy=$PWD/.venv/core/mbsbench
rm -rf .venv/core
mkdir -p "$copy"
git ls-files --cached --others --exclude-standard | tar -cf - -T - | tar -xf - -C "$copy"
cd "$copy"
rm -rf harness/lab harness/formats harness/mechanics/cut_trees solvers/engines reports/lab cli/lab cli/formats kit.py
( cd harness/catalogue/suites && rm -f engines.toml bench_engines.toml engine_defaults.toml frontier.toml )  # runs of engines
sed -i '/^# MuJoCo/,$d' harness/catalogue/suites/field.toml  # the last of its runs, of an engine
rm -rf tests/harness/lab tests/harness/formats tests/solvers/engines tests/cli/lab
git init --quiet . && git add --all
git -c user.name=core -c user.email=core@localhost commit --quiet --message "the core alone"
lines() { git ls-files '*.py' | grep -v '^tests/' | xargs cat | wc -l; }
echo "the core alone: $(lines) lines of Python beside its tests"
make setup
make test
make gate
make bench
