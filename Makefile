# One checkout, one .venv; needs only python3 (3.11 or later). `make help` lists the targets.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
CLUSTER := $(VENV)/.ready-cluster
ENGINES := $(VENV)/.ready-engines $(patsubst locks/requirements-engines-%.lock,$(VENV)/engines/%/.ready,$(wildcard locks/requirements-engines-*.lock))
DOCS := $(VENV)/.ready-docs
AXE := $(VENV)/axe/package/axe.min.js
AXE_VERSION := 4.14.1
AXE_SHA512 := 1477dafa598d8d065f273d6af302aa203c02e83131707b7fa648cd41bd3d6b734f8c22a0dab86ee6a6f64b8afbe804b214d36db85a2826965edfb3a0b9d546b5
RESULTS ?= latest
PROBLEM ?= chain
PICTURES ?= docs/images
SHORTEST := $(addprefix tests/, harness/mechanics/test_joints.py harness/mechanics/test_presentation.py harness/catalogue/suites \
	harness/base/test_clock.py harness/base/test_cheats.py harness/base/test_shapes.py solvers/test_strong_form.py)
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

# a command that may be silent for a minute; on a terminal with the seconds it has taken so far
moving = @echo '$(2)' >&2; $(1) & job=$$!; trap "kill $$job" INT TERM; n=0; while kill -0 $$job 2>/dev/null; do \
	if test -t 2; then printf '\r%d s ' $$n >&2; fi; sleep 1; n=$$((n + 1)); done; \
	if test -t 2; then echo >&2; fi; wait $$job
apt = { apt-get update -qq && apt-get install -y -qq --no-install-recommends $(1); } >&2
# what make bench runs
BENCH = $(if $(wildcard $(ENGINES)),bench_engines,bench)
QEMU := $(VENV)/qemu
BACKPORTS := [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian
APART := -o Dir::Etc::sourcelist=$(CURDIR)/$(QEMU)/list -o Dir::Etc::sourceparts=- -o Dir::State::lists=$(CURDIR)/$(QEMU)/lists \
	-o Dir::Cache=$(CURDIR)/$(QEMU)/cache
COMPARE := $(BIN)/python -m mbsbench.tests.processors.compare_bits
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

.DEFAULT_GOAL := help
.PHONY: help setup test test-rest release core attacks mutants exam test-shapes test-python test-versions test-published test-engines engines test-arm64 test-slow browser check docs format bench bench-kernels timing gate report paper figures pictures joints article tex slurm test-slurm qemu test-processors clean

help: ## print this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

setup: $(READY) ## make .venv with the locked packages and the command mbsbench

$(READY): locks/requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "error: python 3.11 or later is needed (got %s); make PYTHON=..." % sys.version.split()[0])'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(call moving,$(PIP) -r locks/requirements.lock,installing the locked packages)
	$(call moving,$(PIP) --no-deps --no-build-isolation --editable .,installing mbsbench)
	mkdir -p $(VENV)/src && ln -sfn ../.. $(VENV)/src/mbsbench
	@touch $@

SUITE := $(BIN)/python -m pytest -q -n 3 --dist worksteal -m "not slow and not engine and not published" --benchmark-disable
test: $(READY) ## run the tests in minutes: the short ones, and of long sweeps a few cases; not those of engines and of published results
	PYTHONDONTWRITEBYTECODE= $(SUITE) --cases few

test-rest: $(READY) ## run the cases that `make test` leaves out
	PYTHONDONTWRITEBYTECODE= $(SUITE) --cases rest

test-published: $(READY) ## run the tests that hold published results and pictures against this code
	$(BIN)/python -m pytest -q -m "published and not slow" --benchmark-disable tests/cli tests/harness/judge/referee tests/harness/lab/shadow tests/reports

test-shapes: $(READY) ## run tests of mechanics, metrics and problems with the shapes of arrays checked
	SHAPES=1 $(BIN)/python -m pytest -q -n 2 -m "not slow" --benchmark-disable tests/harness/judge/metrics tests/harness/reference \
	tests/problems/test_data.py tests/harness/mechanics/test_joints.py tests/solvers/test_dae_forms.py --ignore=tests/harness/judge/metrics/test_sampling.py

$(CLUSTER): locks/requirements-cluster.lock $(READY)
	$(call moving,$(PIP) -r locks/requirements-cluster.lock,installing locks/requirements-cluster.lock)
	@touch $@

test-python: $(READY) ## with PYTHON=python3.13 or another: try a wheel of this, and run the shortest tests with it
	$(eval OTHER := $(VENV)/python-$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])'))
	test -x $(OTHER)/bin/python || $(PYTHON) -m venv $(OTHER)
	$(call moving,$(OTHER)/bin/python -m pip install --quiet --disable-pip-version-check -r locks/requirements.lock,installing the locked packages)
	rm -rf $(OTHER)/copy $(OTHER)/wheel && mkdir $(OTHER)/copy && git ls-files | tar -cf - -T - | tar -xf - -C $(OTHER)/copy
	$(OTHER)/bin/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir $(OTHER)/wheel $(OTHER)/copy
	$(OTHER)/bin/python -m pip install --quiet --force-reinstall --no-deps $(OTHER)/wheel/*.whl
	cd $(OTHER) && bin/mbsbench solve heavy_top rk45_strong_form --problem-set t_end=0.2 --out heavy_top.npz
	$(OTHER)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	$(OTHER)/bin/python -m pytest -q -p no:cacheprovider -n 2 --benchmark-disable -m "not slow" $(SHORTEST)

test-versions: $(READY) ## try the oldest and the newest versions on PyPI that pyproject.toml allows, and say what broke
	$(BIN)/python -m mbsbench.tests.versions $(SHORTEST)

test-slow: $(CLUSTER) ## run all tests, with those of a cluster (installs Dask)
	$(BIN)/python -m pytest -q -n 2 --benchmark-disable

$(VENV)/.ready-engines: locks/requirements-engines.lock locks/requirements-formats.lock $(READY)
	$(call moving,$(PIP) -r locks/requirements-engines.lock,installing locks/requirements-engines.lock)
	$(call moving,$(PIP) -r locks/requirements-formats.lock,installing locks/requirements-formats.lock)
	@touch $@

$(VENV)/engines/%/.ready: locks/requirements-engines-%.lock
	test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D)
	$(call moving,$(@D)/bin/python -m pip install --quiet --disable-pip-version-check -r $<,installing $<)
	@touch $@

engines: $(ENGINES) ## install other people's engines, and readers of formats; engines that clash in .venv/engines

test-engines: $(ENGINES) ## run the tests of the engines and of mechanisms from files (installs them)
	$(BIN)/python -m pytest -q -n 2 -m "not slow" --benchmark-disable tests/solvers/engines tests/harness/run/test_in_turns.py tests/harness/catalogue \
		tests/harness/formats tests/harness/lab/fuzz tests/cli/test_questions.py
	$(BIN)/python -m pytest -q -n 2 -m slow --benchmark-disable tests/cli/test_questions.py

core: $(READY) ## whether the core is whole: delete lab, formats and engines in a copy, and run its tests, gate and bench; half an hour
	sh tests/core.sh

attacks: $(READY) ## mutate results folders, bundles, tables and models a thousand times each, and count what readers do; an hour
	MUTATIONS=1000 $(BIN)/python -m pytest -q -s tests/attacks
	$(BIN)/python -m tests.attacks.cases

mutants: $(READY) ## turn every sign and factor of the compiled steps, one at a time: the contract with the plain ones must see each; some minutes of processor time
	$(BIN)/python -m mbsbench.tests.solvers.plain.mutants

exam: $(READY) ## run or continue the exam of verdicts: sixteen mechanisms by all solvers, judged by true motions of their own; an hour
	$(BIN)/python -m mbsbench.tests.exam results/local/exam $(if $(EXAMINED),--results $(EXAMINED))

test-arm64: $(READY) ## compare the gate's cases, shortened, with an emulated arm64 bit for bit; half an hour (apt, as root)
	sh tests/processors/arm64.sh

$(DOCS): locks/requirements-docs.lock $(READY)
	$(call moving,$(PIP) -r locks/requirements-docs.lock,installing locks/requirements-docs.lock)
	@touch $@

docs: $(DOCS) ## build the documentation as a site, results/local/site; a broken link fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

check: $(READY) ## check lint, format, types and import layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy $(VENV)/src/mbsbench  # under the package's name, whatever the folder of the checkout is called
	$(BIN)/lint-imports

release: $(READY) ## check that nothing lags behind the version, make its wheel and print how to tag it; tags and pushes nothing
	$(BIN)/python docs/release.py

format: $(READY) ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

browser: ## install Chromium for the tests of pages (apt, as root), or set CHROMIUM to one that is there; fetch axe-core (npm)
	@for c in $(CHROMIUM) chromium chromium-browser google-chrome chrome; do command -v $$c && exit; done; \
	if test "$$(id -u)" != 0 || ! command -v apt-get >/dev/null; then \
	echo "error: no Chromium on this machine, and none can be installed here; set CHROMIUM=/path/to/chromium" >&2; exit 2; fi; \
	apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium
	@test -f $(AXE) || { mkdir -p $(VENV)/axe && cd $(VENV)/axe && npm pack --silent axe-core@$(AXE_VERSION) && \
	echo '$(AXE_SHA512)  axe-core-$(AXE_VERSION).tgz' | sha512sum --check --quiet && tar -xzf axe-core-$(AXE_VERSION).tgz; } || \
	{ echo 'error: axe-core could not be fetched with npm: the tests of accessibility cannot run' >&2; exit 2; }

bench: $(READY) ## run the suite `bench` (with engines where `make engines` has been run) in two passes, each judged and reported: the main result
	$(BIN)/mbsbench run $(BENCH) --only first
	$(BIN)/mbsbench report --judge
	$(BIN)/mbsbench run $(BENCH) --resume
	$(BIN)/mbsbench report --judge

paper: $(READY) ## judge the paper (an hour on two cores): run or resume the suite `referee`; verdicts, figures, report
	$(BIN)/mbsbench run referee --resume
	@status=0; $(BIN)/mbsbench judge || status=$$?; test $$status -le 1 || exit $$status; \
	$(BIN)/mbsbench figures --paper && $(BIN)/mbsbench report && exit $$status

figures: $(READY) ## publication figures and tables of RESULTS (the newest), or of one PROBLEM of them
	$(BIN)/mbsbench figures $(RESULTS) $(if $(filter command line environment,$(origin PROBLEM)),--only $(PROBLEM))

pictures: $(READY) ## the pictures of the README and docs/judging.md, from RESULTS (the newest) and two runs made here
	$(BIN)/python docs/draw_pictures.py $(RESULTS) $(PICTURES)

joints: $(READY) ## the pictures of the joints in docs/joints-and-forces.md, from their rows
	$(BIN)/python docs/draw_joints.py $(PICTURES)/joints

article: $(READY) ## the article on what was found, from results/published: HTML, LaTeX and, with pdflatex, PDF
	$(BIN)/python docs/article/build_article.py results/local/article

tex: ## install pdflatex for the article (apt, as root)
	@command -v pdflatex >/dev/null || $(call apt,texlive-latex-base texlive-latex-recommended lmodern)

slurm: ## install SLURM for its test (apt, as root)
	@test -x /usr/sbin/slurmctld || $(call apt,slurm-wlm munge)

test-slurm: $(CLUSTER) slurm ## run a suite on a SLURM of one node, started for the test (as root)
	$(BIN)/python -m pytest -q -rs --benchmark-disable tests/harness/run/test_slurm.py

qemu: $(READY) ## install qemu-user, which emulates processors (apt, as root); where that errs, a newer one of backports into .venv/qemu
	@command -v qemu-x86_64 >/dev/null || test -x $(QEMU)/usr/bin/qemu-x86_64 || test "$$(id -u)" != 0 || $(call apt,qemu-user) || true
	@$(COMPARE) --check 2>/dev/null || ! command -v apt-get >/dev/null || { rm -rf $(QEMU) && mkdir -p $(QEMU)/lists/partial $(QEMU)/cache/archives/partial && \
	. /etc/os-release && echo "deb $(BACKPORTS) $$VERSION_CODENAME-backports main" >$(QEMU)/list && cd $(QEMU) && \
	apt-get -qq $(APART) update && apt-get -qq $(APART) download qemu-user && \
	dpkg --fsys-tarfile qemu-user_*.deb | tar -x ./usr/bin/qemu-x86_64 && rm -rf qemu-user_*.deb lists cache; } >/dev/null 2>&1 || true
	@$(COMPARE) --check

test-processors: qemu ## compare bits of short runs and suite `ci` with those on an emulated Haswell (20 minutes), or on PROCESSORS; with SHORT=1 short runs alone
	$(call moving,$(COMPARE) --processors $(or $(PROCESSORS),Haswell) --suites families $(if $(SHORT),,ci),comparing bits with those of an emulated processor)

report: $(READY) ## write the report of the newest results
	$(BIN)/mbsbench report

gate: $(READY) ## run the suite `ci` and compare it with results/baselines/ci.toml
	$(BIN)/mbsbench gate

timing: $(READY) ## compare CPU times of suite `ci` on empty caches with five warm repeats, solver by solver (about 15 minutes)
	$(BIN)/python -m mbsbench.tests.benchmarks.cold_and_warm

bench-kernels: $(READY) ## time the kernels and compare with the last timings of this machine
	$(BIN)/python -m pytest -q tests/benchmarks --benchmark-only --benchmark-autosave --benchmark-storage results/local/kernels \
		$(if $(wildcard results/local/kernels/*),--benchmark-compare)

clean: ## remove results/local and caches; keep .venv
	rm -rf results/local .pytest_cache .hypothesis .benchmarks .mypy_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
