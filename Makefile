# Each target prepares .venv first where that is needed; nothing is installed outside this folder.
#   make demo    the bundled examples in one table and one picture, results in demo/; two minutes on a
#                fresh machine: it installs only what it runs, the other targets add the rest
#   make test    tests, without the slow ones; PART=anhyst, anhyst-rigs, anhyst-exchange or c (core and
#                firmware) for one part
#   make check   format, lint, types, C analysis
#   make test-all  the slow ones too   make campaign  repeats of slow ones on further magnets and compilers
#   make held    those that depend on C alone, recorded for .ci/run in tests/held.toml (test-all does so too)
#   make prove   proofs of the fixed-point C that changed   make prove-all  all of them
#   make bench   the table of figures; WHAT="laws speed" for files of benchmarks/ by name. WHAT=search
#                tries the search on 200 drawn measurements, in half an hour; only where it is named
#   make zoo     the open benchmark of hysteresis models, in build/zoo/; ARGS="--task NAME" for a part
#   make format  lay out Python and C sources
#   make messages  gather how every error is worded
#   make docs    the documentation site, in build/site/
#   make house   count rooms, imports, circles, lines; follow a model to C and a rig to a recording;
#                count sentences and names that are hard to read
#   make build   compile the core again, install what tests and checks need
#   make clean   remove what make made, .venv too
#   make wheel   wheels for Linux in dist/, tried in an empty environment; PYTHONS="p q" for others
#   make truths  identify the models again that tests start from
#   make fuzz    ten million inputs to the firmware; RUNS=n for another number
PYTHON ?= python3
BIN := .venv/bin

# A worker for each core, but each reads all tests first; one that is through takes over half of what
# another has left.
PARALLEL := --numprocesses auto --maxprocesses 8 --dist worksteal

# What `make test PART=...` runs; without it all.
TESTS := $(if $(PART),$(if $(filter c,$(PART)),tests/core tests/firmware,packages/$(PART)))

C_SOURCES := $(shell find core plant firmware tests/core tests/firmware packages/*/tests -name '*.c' -o -name '*.h') \
	$(wildcard packages/anhyst/src/anhyst/_core/*.cpp packages/anhyst/src/anhyst/_core/*.h packages/anhyst-exchange/src/anhyst_exchange/fmu/*.[ch])
BUILD_INPUTS := $(wildcard packages/*/pyproject.toml packages/*/CMakeLists.txt) core/core.cmake plant/plant.cmake \
	$(shell find core plant packages/anhyst/src/anhyst/_core -name '*.[ch]' -o -name '*.cpp')

.PHONY: demo test test-all held campaign check docs house messages prove prove-all bench zoo build wheel format \
	clean fuzz truths \
	check-python check-imports check-c-format check-c-tidy check-cppcheck

demo: .venv/.stamp-package
	@$(BIN)/python examples/demo.py

test: build
	@$(BIN)/python -m pytest $(PARALLEL) -m "not slow" $(TESTS)

test-all: build
	@ANHYST_HELD=$${ANHYST_HELD:-record} $(BIN)/python -m pytest $(PARALLEL) -m "not campaign"

held: build
	@rm -f tests/held.toml
	@ANHYST_HELD=record $(BIN)/python -m pytest $(PARALLEL) -m "depends and not campaign"

campaign: build
	@$(BIN)/python -m pytest $(PARALLEL) -m campaign

docs: build
	@$(BIN)/python tools/docs

messages: build
	@$(BIN)/python tools/messages.py

house: build
	@$(BIN)/python -m tools.house
	@$(BIN)/python -m tools.plain_english

prove: build
	@$(BIN)/python -m tools.prove

prove-all: build
	@$(BIN)/python -m tools.prove --all

bench: build .venv/.stamp-bench
	@$(BIN)/python benchmarks/run.py $(WHAT)

zoo: .venv/.stamp-package .venv/.stamp-bench
	@$(BIN)/python -m benchmarks.zoo run $(ARGS)

check: check-python check-imports check-c-format check-c-tidy check-cppcheck
	@echo "check: all clean"

build: .venv/.stamp-package .venv/.stamp-dev

wheel: build
	@$(BIN)/python -m tools.wheel $(PYTHONS)

check-python: build
	@echo "check: ruff, mypy"
	@$(BIN)/ruff format --check --quiet --diff
	@$(BIN)/ruff check --quiet
	@$(BIN)/mypy --no-error-summary

check-imports: build
	@echo "check: import-linter"
	@$(BIN)/lint-imports --no-cache > build/imports.log || { cat build/imports.log; exit 1; }

check-c-format: build
	@echo "check: clang-format"
	@$(BIN)/clang-format --dry-run -Werror $(C_SOURCES)

check-c-tidy: build/analysis/compile_commands.json
	@echo "check: clang-tidy"
	@$(BIN)/python $(BIN)/run-clang-tidy.py \
		-clang-tidy-binary $(BIN)/clang-tidy -p build/analysis -quiet -warnings-as-errors='*' \
		> build/tidy.log 2>&1 || { grep -E -A4 'error:|warning:' build/tidy.log; exit 1; }

# Right shifts of negative numbers keep the sign (port.h does not compile where they do not), and
# a shift of the largest number by 31 to the right leaves 0.
check-cppcheck: build/analysis/compile_commands.json
	@echo "check: cppcheck"
	@$(BIN)/cppcheck --project=build/analysis/compile_commands.json --quiet --std=c99 \
		--enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
		--suppress=shiftNegativeLHS --suppress=shiftTooManyBitsSigned

truths: build
	@OPENBLAS_NUM_THREADS=1 PYTHONPATH=packages/anhyst:packages/anhyst-rigs:. $(BIN)/python -m tests.kept_models $(NAMES)

fuzz: build
	@$(BIN)/python tools/fuzz.py $(if $(RUNS),--runs $(RUNS))
	@$(BIN)/python tools/fuzz_files.py
	@ANHYST_RANDOM=1 $(BIN)/python -m pytest -q tests/property

format: build
	@$(BIN)/ruff format --quiet
	@$(BIN)/ruff check --fix --quiet
	@$(BIN)/clang-format -i $(C_SOURCES)

clean:
	rm -rf .venv build demo .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find packages tests examples benchmarks -name __pycache__ -type d -exec rm -rf {} +

# The analysers read how each file of the core and its C tests is compiled.
build/analysis/compile_commands.json: CMakeLists.txt core/core.cmake tests/core/CMakeLists.txt \
		.venv/.stamp-package
	@$(BIN)/cmake -S . -B build/analysis -G Ninja -DANHYST_TESTS=ON \
		-DCMAKE_MAKE_PROGRAM=$(CURDIR)/$(BIN)/ninja -DCMAKE_EXPORT_COMPILE_COMMANDS=ON > /dev/null
	@touch $@

.venv/.stamp-packages: tools/environment.py $(wildcard packages/*/pyproject.toml)
	@$(PYTHON) tools/environment.py
	@touch $@

.venv/.stamp-package: .venv/.stamp-packages $(BUILD_INPUTS)
	@$(PYTHON) tools/environment.py --package
	@touch $@

.venv/.stamp-dev: .venv/.stamp-packages pyproject.toml
	@$(PYTHON) tools/environment.py --group dev
	@touch $@

.venv/.stamp-bench: .venv/.stamp-packages pyproject.toml
	@$(PYTHON) tools/environment.py --group bench
	@touch $@
