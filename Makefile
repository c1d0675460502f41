# make run   sets everything up and does the main job: recordings in, dead bands and a report out
# make test  sets everything up and runs what a change is most likely to break, in every language
# make verify runs all the rest: matrices, long properties, soaks, other makers' stacks, Spark, the gallery, the browser
# make check is what a developer runs all day: linters, the blocks, and every Python test that takes less than a sixth of a second
.PHONY: run test verify check quick setup lint lint-rust lint-python rust compiled rust-checked bare embedded interop spark reader page capi wheels site bench catalogue gallery plc fuzz lock audit clean
.DELETE_ON_ERROR:

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Packages as a lock of requirements/ names them, each with the checksum of its file, and no others.
INSTALL = $(BIN)/pip install --quiet --no-deps --require-hashes --requirement
# Tests start many processes, and each would compile all it imports.
unexport PYTHONDONTWRITEBYTECODE
, := ,
SOURCES := $(shell find crates -name '*.rs' -o -name Cargo.toml) Cargo.toml Cargo.lock pyproject.toml

run: $(VENV)/.installed
	$(call stage,Analyse five demonstration loops,10 s)
	$(BIN)/glapp demo out/demo --force
	$(BIN)/glapp analyze out/demo/loops.toml --report out/report.html
	@echo
	@echo "Your own loop:  $(BIN)/glapp analyze YOUR.csv --report out/your.html     ($(BIN)/glapp --help tells more)"

# Says what begins, and how long it takes from nothing on two idle cores.
stage = @printf '\n== %s: about %s\n' '$(1)' '$(2)'

# What the analysis needs, and no more.
$(VENV)/.packages: requirements/run.txt
	$(call stage,Install Python packages,15 s)
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) requirements/run.txt
	touch $@

# A release wheel, as a user gets it, with the Python sources in place so that they can be edited.
$(VENV)/.installed: $(VENV)/.packages $(SOURCES)
	$(call stage,Compile the Rust crates,2 min the first time$(,) less after a change)
	PIP_QUIET=1 VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --release
	touch $@

# What tests and linters need beside it.
setup: $(VENV)/.tools

$(VENV)/.tools: requirements/test.txt $(VENV)/.installed
	$(call stage,Install the tools of tests and linters,25 s)
	$(INSTALL) requirements/test.txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable thesis
	touch $@

# One cargo at a time compiles: a second waits for its lock, and holds a processor meanwhile. What leaves a processor
# idle has another beside it; the tests of Python, which leave none, come last.
test: $(VENV)/.installed
	$(call stage,Compile Rust tests and C library$(,) lint Python,4 min from nothing)
	@+$(MAKE) --no-print-directory --jobs=2 compiled lint-python reader
	$(call stage,Rust tests$(,) clippy,1 min)
	@+$(MAKE) --no-print-directory --jobs=2 rust lint-rust
	$(call stage,Python tests,4 min)
	$(BIN)/pytest --numprocesses auto --dist loadgroup --durations=20 -m "not verify"

# Each part is named as it begins, and with its time as it ends. While one waits for the network another compiles. What runs by the
# clock leaves the processor idle most of the time and comes first to it; then the page, for which the other tests wait.
VERIFIED := rust-checked interop spark site page clock bare others
verify: setup $(VENV)/.docs
	@+$(MAKE) --no-print-directory --jobs=4 $(VERIFIED:%=timed-%)

.PHONY: clock others $(VERIFIED:%=timed-%)
# Only the files that hold such a test are read. What fails beside others is run once more, alone: other work on the machine must not
# decide. What failed by the clock is kept apart from what failed among the others.
marked = -m '$(1)' $$(grep --files-with-matches 'mark\.$(firstword $(1))' tests/test_*.py)
verified = $(BIN)/pytest --verbose --numprocesses $(1) --dist loadgroup $(3) $(call marked,$(2)) || \
	{ printf '\n== What failed, once more and alone\n'; $(BIN)/pytest --verbose --numprocesses 0 --last-failed $(3) $(call marked,$(2)); }
clock:
	$(call verified,5,by_the_clock,--override-ini cache_dir=.pytest_cache/clock)

others:
	$(call verified,auto,verify and not by_the_clock,--durations=20)

timed-clock: timed-interop
timed-others: timed-interop timed-spark timed-site timed-page
NICE = $(if $(filter clock,$*),,nice $(if $(filter page,$*),-n 5))
$(VERIFIED:%=timed-%): timed-%:
	@+printf '\n== %s\n' '$*'; began=$$(date +%s); $(NICE) $(MAKE) --no-print-directory $* && \
		printf '== %s took %d s\n' '$*' $$(($$(date +%s) - began))

check: setup
	@+$(MAKE) --no-print-directory --jobs=2 quick lint

quick:
	cargo test --release --quiet $(TESTED:%=-p glapp-%) --lib --test blocks
	cargo test --release --quiet -p glapp-plc-check --test twins vectors
	$(BIN)/pytest --numprocesses auto --dist loadgroup -m "not slow and not verify" tests

# As they are shipped, with the crates that `make run` has compiled: the Python face is among them, since its dependencies choose
# features of theirs.
TESTED := core model fit sim analysis capi embedded plc-check py
rust:
	+cargo test --release --quiet $(TESTED:%=-p glapp-%)

compiled:
	+cargo test --release --quiet --no-run $(TESTED:%=-p glapp-%)
	+$(MAKE) --no-print-directory capi

# The same with all checks of arithmetic left in, and the crates that show the others. Those that hand on to Python and read Parquet
# have large dependencies, which are compiled only as they are shipped; they come first, while no test of Python asks for
# what cargo made.
rust-checked:
	+cargo test --release --quiet -p glapp-lake -p glapp-py
	+cargo test --workspace --exclude glapp-py --exclude glapp-lake --exclude glapp-bench --quiet

lint: lint-python lint-rust

lint-rust:
	cargo fmt --check
	+cargo clippy --release --workspace --all-targets --quiet -- --deny warnings

lint-python: setup
	$(BIN)/ruff format --check python thesis tests examples bench vectors fuzz plc docs page wheels requirements
	$(BIN)/ruff check python thesis tests examples bench vectors fuzz plc docs page wheels requirements
	$(BIN)/mypy

# The core where there is no operating system: a microcontroller, and a page in the browser.
bare:
	@+for target in thumbv7em-none-eabihf wasm32-unknown-unknown; do \
		if [ -d "$$(rustc --print target-libdir --target $$target)" ]; then \
			cargo build --quiet --release -p glapp-core --target $$target || exit 1; \
		else \
			echo "skipped: glapp-core for $$target, which this toolchain lacks (rustup target add $$target)"; \
		fi; \
	done

# The library for microcontrollers, with its header and the example.
BARE := thumbv7em-none-eabihf
embedded:
	@if [ -d "$$(rustc --print target-libdir --target $(BARE))" ]; then \
		cargo rustc --quiet --profile embedded -p glapp-embedded --crate-type staticlib --target $(BARE) && \
		rm -rf dist/embedded && mkdir -p dist/embedded/lib && \
		cp -r crates/embedded/include crates/embedded/example LICENSE dist/embedded && \
		cp target/$(BARE)/embedded/libglapp_embedded.a dist/embedded/lib && echo "dist/embedded"; \
	else \
		echo "skipped: glapp-embedded for $(BARE), which this toolchain lacks (rustup target add $(BARE))"; \
	fi

# For the test that Spark gives the same tables.
spark: setup
	@if command -v java >/dev/null; then $(MAKE) --no-print-directory $(VENV)/.spark; \
		else echo "skipped: the fleet on Spark, which needs java"; fi

$(VENV)/.spark: requirements/spark.txt
	$(INSTALL) $< --no-build-isolation
	touch $@

# Two OPC UA stacks of other makers, for the tests of the connection: from npm as the lock says, and from Maven.
THEIRS := target/interop
MILO := $(wildcard tests/interop/milo/src/main/java/*.java) tests/interop/milo/pom.xml
interop:
	@if command -v node >/dev/null && command -v npm >/dev/null; then $(MAKE) --no-print-directory $(THEIRS)/.node; \
		else echo "skipped: the connection beside node-opcua, which needs node and npm"; fi
	@if command -v java >/dev/null && command -v mvn >/dev/null; then $(MAKE) --no-print-directory $(THEIRS)/.milo; \
		else echo "skipped: the connection beside Eclipse Milo, which needs java and mvn"; fi

$(THEIRS)/.node: tests/interop/package.json tests/interop/package-lock.json
	mkdir -p $(THEIRS)
	cp $^ $(THEIRS)
	npm ci --prefix $(THEIRS) --no-audit --no-fund --loglevel=error
	touch $@

$(THEIRS)/.milo: $(MILO)
	mvn --quiet --batch-mode --file tests/interop/milo/pom.xml -Dout=$(abspath $(THEIRS))/milo compile
	touch $@

# What the page reads files with, for its tests in node.
reader: setup
	@if command -v npm >/dev/null; then $(BIN)/python page/build.py --reader; else echo "skipped: the page's reader, which needs npm"; fi

# The page in the browser: dist/page/index.html, which works from the disk.
page: setup dist/page/index.html

dist/page/index.html: $(SOURCES) $(shell find page python/glapp -type f -not -name '*.pyc' -not -name '*.so')
	$(call stage,Compile the fit for the browser and build the page,4 min the first time$(,) 1 min after a change of a crate)
	+$(BIN)/python page/build.py dist/page

# The library for C: header, shared and static library, examples. On Linux the version of its interface stands in its name.
capi: dist/capi/include/glapp.h

dist/capi/include/glapp.h: $(SOURCES) $(wildcard crates/capi/include/* examples/c/*) docs/c.md
	+cargo rustc --release --quiet -p glapp-capi --lib --crate-type cdylib,staticlib \
		$(if $(filter Linux,$(shell uname)),-- -C link-arg=-Wl$(,)-soname$(,)libglapp.so.1)
	rm -rf dist/capi
	mkdir -p dist/capi/lib dist/capi/examples dist/capi/include
	for file in libglapp.a libglapp.dylib glapp.dll libglapp.dll.a glapp.dll.lib glapp.lib; do \
		if [ -f target/release/$$file ]; then cp target/release/$$file dist/capi/lib; fi; \
	done
	if [ -f target/release/libglapp.so ]; then \
		cp target/release/libglapp.so dist/capi/lib/libglapp.so.1 && ln -s libglapp.so.1 dist/capi/lib/libglapp.so; \
	fi
	cp examples/c/*.c dist/capi/examples
	cp LICENSE dist/capi
	cp docs/c.md dist/capi/README.md
	cp crates/capi/include/glapp.h $@

# A wheel for every desk, and the source package: dist/wheels. What cannot be built or tried here is named.
wheels: setup $(VENV)/.wheels
	$(BIN)/python wheels/build.py dist/wheels

$(VENV)/.wheels: requirements/wheels.txt $(VENV)/.tools
	$(INSTALL) requirements/wheels.txt
	touch $@

bench: setup $(VENV)/.bench
	cargo bench --quiet -p glapp-bench
	$(BIN)/python -m bench.run
	$(BIN)/python -m bench.sim
	$(BIN)/python -m bench.tuning
	$(BIN)/python -m bench.fit
	$(BIN)/python -m bench.scan
	$(BIN)/python -m bench.size

$(VENV)/.bench: requirements/bench.txt $(VENV)/.tools
	$(INSTALL) requirements/bench.txt
	touch $@

# The documentation in dist/site, to be read without a server; a link that leads nowhere ends it.
site: setup $(VENV)/.docs
	$(call stage,Build the documentation,10 s)
	@if command -v npm >/dev/null; then \
		$(MAKE) --no-print-directory target/site/.npm && NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict; \
		else echo "skipped: the site of the documentation, which needs npm"; fi

$(VENV)/.docs: requirements/docs.txt $(VENV)/.tools
	$(INSTALL) requirements/docs.txt
	touch $@

# By this the pages of a folder can be searched.
target/site/.npm:
	npm install --prefix target/site --no-audit --no-fund --loglevel=error iframe-worker@1.0.4
	touch $@

# Names, numbers, units, bounds and defaults, from the crates into vectors/catalogue.json; the site shows them as a page.
catalogue: setup
	cargo run --quiet -p glapp-analysis --example catalogue > vectors/catalogue.json.new
	mv vectors/catalogue.json.new vectors/catalogue.json

# The figures of the thesis with their numbers, as docs/gallery has them, and the table of docs/thesis.md.
gallery: setup
	$(BIN)/glapp thesis --out docs/gallery --markdown
	$(BIN)/python -m glapp_thesis

# The Structured Text of plc/ for the makers' tools, the same bytes each time.
plc:
	$(PYTHON) plc/package.py dist/plc

# Wrong input by the million; SECONDS=600 goes on for longer, FILES=20000 damages more of each kind, SEED=7 the same again.
SECONDS ?= 60
FILES ?= 3000
fuzz: setup $(VENV)/.fuzz
	RUSTC_BOOTSTRAP=1 cargo fuzz run detector -- -max_total_time=$(SECONDS)
	RUSTC_BOOTSTRAP=1 cargo fuzz run capi -- -max_total_time=$(SECONDS)
	$(BIN)/python fuzz/read_csv.py -max_total_time=$(SECONDS)
	$(BIN)/python fuzz/read_tables.py --files $(FILES) $(if $(SEED),--seed $(SEED))
	$(BIN)/python fuzz/read_tables.py --files $(FILES) $(if $(SEED),--seed $(SEED)) --command-line

$(VENV)/.fuzz: requirements/fuzz.txt $(VENV)/.tools
	command -v cargo-fuzz >/dev/null || cargo install --quiet cargo-fuzz
	$(INSTALL) requirements/fuzz.txt
	touch $@

# The locks of the Python packages anew: the newest versions that pyproject.toml allows.
lock:
	$(PYTHON) -m venv target/lock
	target/lock/bin/pip install --quiet --no-deps --require-hashes --requirement requirements/lock.txt
	target/lock/bin/python requirements/lock.py

# All locks beside a data base of advisories: error 1 where one names a package, error 3 where none can be reached.
audit:
	$(PYTHON) requirements/audit.py

clean:
	rm -rf target out dist $(VENV)
