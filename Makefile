# What a machine needs: Python 3.11 or later, make, and a C++17 compiler. Everything else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
CXX ?= c++
RIG := bartels2026-validation
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
INSTALL := $(if $(shell command -v uv),uv pip install --quiet --python $(BIN)/python,$(PIP)) -c constraints.txt
BUILD_TOOLS := scikit-build-core nanobind numpy hatch-fancy-pypi-readme $(foreach tool,cmake ninja,$(if $(shell command -v $(tool)),,$(tool)))
# What is fetched after the tests were installed compiles the kernels as these need them.
export TENSIONLAB_BUILDS ?= $(if $(wildcard .venv/dev.stamp),runnable,native)
NATIVE := $(wildcard include/*.h include/*/*.hpp include/*/*/*.hpp tensionlab/native/*/*.[ch]pp firmware/*/*.[ch]pp)

.PHONY: demo install test test-fast test-lowest coverage check firmware-check model dangers emulate sanitize sbom release-check format bench bench-quick bench-readme bench-workspace bench-runner stress file-fuzz soak drift faults impacts what-if hostile figures docs docs-check playground notebooks generated checksums clean

demo: .venv/user.stamp
	@mkdir -p out
	@$(BIN)/tensionlab compare $(RIG) --plot out/compare.png

# Bytecode is kept even where the environment says no: rewriting the tests' assertions takes ten seconds a process.
test test-fast: export PYTHONDONTWRITEBYTECODE :=

# What needs the wall clock runs after the others, one by one; only files that have such tests are read.
test: .venv/dev.stamp
	@status=0; \
	$(BIN)/pytest -n auto --dist worksteal -m "not realtime" --durations 10 || status=1; \
	$(BIN)/pytest -m realtime --durations 10 $$(grep -rl mark.realtime tests --include 'test_*.py') || status=1; \
	exit $$status

test-fast: .venv/dev.stamp
	@$(BIN)/pytest -n auto --dist worksteal -m "not realtime"

# The lowest versions that pyproject.toml declares, by the tests of what uses them. What is newer beneath these warns of
# what is old, so here a warning is no error.
DOORS := $(addprefix tests/,solvers/test_convex.py solvers/test_plugins.py solvers/test_quadratic.py model plots \
  workspace/sweep hardware/client hardware/log haptics/bridge viewer cli benchmark/test_comparison.py support interop)
test-lowest: .venv-lowest/dev.stamp
	@.venv-lowest/bin/pytest -n auto --dist worksteal -W ignore -m "not realtime and not slow" $(DOORS)

.venv-lowest/dev.stamp: pyproject.toml CMakeLists.txt $(NATIVE)
	@$(PYTHON) -m venv --clear .venv-lowest
	@.venv-lowest/bin/pip install --quiet --disable-pip-version-check uv
	@TENSIONLAB_BUILDS=native .venv-lowest/bin/uv pip install --quiet --python .venv-lowest/bin/python \
	  --resolution lowest-direct --config-setting build-dir=build/lowest -e '.[dev]'
	@touch $@

# Lines and branches that these tests do not reach, by file.
coverage: .venv/dev.stamp
	@mkdir -p out/coverage
	@$(BIN)/pytest -n auto -m "not realtime" --cov --cov-report term

check: .venv/dev.stamp
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/win32 -p tensionlab & windows=$$!; \
	  $(BIN)/mypy && wait $$windows
	@$(BIN)/clang-format --dry-run --Werror $(NATIVE) playground/kernels.cpp
	@$(BIN)/zizmor --offline --quiet --no-progress .github/workflows
	@if command -v actionlint >/dev/null; then actionlint; fi

format: .venv/dev.stamp
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .
	@$(BIN)/clang-format -i $(NATIVE) playground/kernels.cpp

bench: .venv/dev.stamp
	@$(BIN)/tensionlab bench --out out/bench

bench-quick: .venv/dev.stamp
	@$(BIN)/tensionlab bench --quick --out out/bench-quick

bench-readme: bench
	@$(BIN)/python -m tools.generate_benchmark_table out/bench
	@$(BIN)/python -m tools.checksums
	@$(BIN)/python -m tools.generate_docs

bench-workspace: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.workspace
	@$(BIN)/python -m benchmarks.certify

stress: .venv/dev.stamp
	@TENSIONLAB_STRESS=500 $(BIN)/pytest -n auto tests/stress/test_stress.py
	@TENSIONLAB_STRESS=150 $(BIN)/pytest -n auto tests/stress/test_verdicts.py

file-fuzz: .venv/dev.stamp
	@TENSIONLAB_STRESS=500 $(BIN)/pytest -n auto tests/stress/test_file_fuzz.py tests/stress/test_codec_fuzz.py

soak: .venv/dev.stamp
	@TENSIONLAB_STRESS=75 $(BIN)/pytest tests/stress/test_soak.py

drift: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.length_drift

faults: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.telemetry_faults

hostile: .venv/dev.stamp
	@$(BIN)/python -m tests.stress.hostile_client

impacts: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.impacts

bench-runner: .venv/dev.stamp
	@$(BIN)/python -m benchmarks.runner

what-if: .venv/dev.stamp
	@$(BIN)/python paper_figures/what_if.py --out datasets/what-if/paper-like-simulated.parquet

figures: .venv/dev.stamp playground
	@$(BIN)/python paper_figures/make.py
	@$(BIN)/python paper_figures/pictures.py

# The site: out/site/index.html. A warning is an error.
docs: .venv/docs.stamp playground
	@rm -rf docs/reference/generated out/site
	@$(BIN)/sphinx-build --jobs 2 --keep-going --fail-on-warning --quiet -c docs -d build/site/doctrees . out/site
	@cp out/playground.html out/site/
	@test -f out/site/docs/index.html  # sphinx-build with several jobs may end in peace without having written
	@echo "out/site/index.html"

# The same in a browser: every page, link and anchor, the search, equations and pictures; screenshots in out/site-check.
docs-check: docs
	@$(BIN)/python -m tools.site.check out/site

# Runs the notebooks, and stores what they show; a second time changes nothing.
notebooks: .venv/dev.stamp
	@$(BIN)/python -m tools.notebooks

# What stands between marks in Markdown files: the output of commands, and tables from committed results and code.
generated: .venv/dev.stamp
	@$(BIN)/python -m tools.generate_docs
	@$(BIN)/tensionlab bench submit benchmarks/submissions --out benchmarks/submissions/README.md > /dev/null

checksums: .venv/bin/python
	@$(BIN)/python -m tools.checksums

# Sizes, sanitizers and fuzzing; what needs a tool that is not there is left out.
firmware-check: .venv/dev.stamp
	@$(BIN)/python firmware/check.py

# The supervisor and a host's stop, in all states that SPIN finds: a minute. `--write` keeps the figures.
model: .venv/dev.stamp
	@$(BIN)/python firmware/model/check.py

# A thousand runs of each danger: a quarter of an hour on two cores. `--write` keeps the figures.
dangers: .venv/dev.stamp
	@$(BIN)/python firmware/dangers.py

# Core and allocator on emulated processors, 10^5 steps and problems each: some minutes. `--write` keeps the figures.
emulate: .venv/dev.stamp
	@$(BIN)/python firmware/emulate.py

# Native code under the sanitizers of GCC.
sanitize: .venv/dev.stamp
	@PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m tools.sanitize

# What an installation of WHEEL, or of these sources, consists of, in CycloneDX format.
WHEEL ?= .
sbom: .venv/tools.stamp
	@mkdir -p out build
	@$(BIN)/python -m venv --clear build/sbom-tool && build/sbom-tool/bin/pip install --quiet cyclonedx-bom
	@$(BIN)/python -m venv --clear --without-pip build/sbom
	@build/sbom-tool/bin/pip --python build/sbom/bin/python install --quiet -c constraints.txt "$(WHEEL)"
	@build/sbom-tool/bin/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml --mc-type library \
	  --output-file out/tensionlab.cdx.json build/sbom/bin/python
	@echo out/tensionlab.cdx.json

# Everything that a machine can check before a release, in an empty clone of the last commit: a quarter of an hour.
release-check:
	@.ci/release-check

.venv/docs.stamp: .venv/user.stamp
	@echo "Fetching what builds the site ..."
	@$(INSTALL) --no-build-isolation -e '.[docs]'
	@touch $@

# One page for any browser, without a network: the exact solver, compiled to WebAssembly, and every committed rig.
playground: .venv/playground.stamp
	@$(BIN)/python playground/build.py

.venv/playground.stamp: .venv/user.stamp
	@echo "Fetching a compiler for WebAssembly ..."
	@$(INSTALL) ziglang
	@touch $@

# The module's printed parts as STEP, STL and pictures: out/kit. `$(BIN)/python -m kit.build --pictures` draws those that
# kit/README.md shows.
kit: .venv/kit.stamp
	@$(BIN)/python -m kit.build

.venv/kit.stamp: .venv/user.stamp
	@echo "Fetching what makes solids ..."
	@$(INSTALL) build123d
	@touch $@

clean:
	rm -rf .venv .venv-lowest build out docs/reference/generated

.venv/bin/python:
	@command -v $(PYTHON) >/dev/null || { echo "No Python: '$(PYTHON)' was not found."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "tensionlab needs Python 3.11 or later; $(PYTHON) is older. Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@command -v $(CXX) >/dev/null || \
	  { echo "No C++ compiler: '$(CXX)' was not found. Install one (Debian: apt install g++; macOS: xcode-select --install)."; exit 1; }
	@$(PYTHON) -m venv .venv || \
	  { echo "$(PYTHON) cannot make a virtual environment. Debian and Ubuntu: apt install python3-venv."; rm -rf .venv; exit 1; }

# What builds the package stays in .venv, so that a change of one file compiles no other again.
.venv/tools.stamp: .venv/bin/python constraints.txt
	@echo "Fetching what builds the package ..."
	@$(INSTALL) $(BUILD_TOOLS)
	@touch $@

.venv/user.stamp: .venv/tools.stamp pyproject.toml CMakeLists.txt $(NATIVE)
	@echo "Compiling the kernels for this processor (a minute on two cores) ..."
	@$(INSTALL) --no-build-isolation --no-deps -e .
	@echo "Fetching the libraries and the solvers to compare with ..."
	@$(INSTALL) --no-build-isolation -e '.[solvers]' cvxpy-base
	@touch $@

install: .venv/user.stamp
	@echo "Fetching the libraries of all verbs ..."
	@$(INSTALL) --no-build-isolation -e '.[solvers,data,workspace,cluster,hardware,haptics,view,notebooks]'
	@echo "Installed. Next:"
	@echo "  source .venv/bin/activate"
	@echo "  tensionlab view $(RIG)     # a rig in the browser"
	@echo "  tensionlab run $(RIG) --force 0.5 0 0 --seconds 3     # modules, simulated in this process"
	@echo "  tensionlab -h     # all verbs; docs/get-started/index.md is a tour"

# Tests compare the kernels of all instruction sets that this processor has. What the libraries' modules compile to is
# left to the first process that imports them: compiling all takes a minute on one core, and few are imported.
.venv/dev.stamp: .venv/tools.stamp pyproject.toml CMakeLists.txt $(NATIVE)
	@echo "Compiling the kernels for the instruction sets of this processor (two minutes on two cores), and fetching what the tests need ..."
	@TENSIONLAB_BUILDS=runnable $(INSTALL) --no-compile --no-build-isolation -e '.[dev]'
	@touch $@ .venv/user.stamp
