# Every command that a user or a build server runs on this project. `make serve` and `make test` need nothing but a clone
# and Rust (and Node, for the tests): they install what is missing, or say what to install.
#
# Why it is built the way it is:
# - One profile, release, for serving, testing and measuring: path tracing on a software GPU is far too slow otherwise,
#   and one profile means that everything is compiled once. Overflow checks stay on in it.
# - `make test` builds programs and tests in one call of cargo, because cargo chooses features per call: two calls would
#   compile some dependencies twice.
# - Tests that use the GPU run at most two at a time (.config/nextest.toml): a software GPU uses every core by itself.

SHELL := /bin/bash
.DEFAULT_GOAL := help
ARGS ?=
CARGO ?= cargo
BENCH ?= $(or $(CARGO_TARGET_DIR),target)/release/surfelcast-bench
SURFELCAST ?= $(or $(CARGO_TARGET_DIR),target)/release/surfelcast
DOCS_SPP ?= 512
# Reconstructions while surfels have few rays.
DOCS_EARLY = $(SURFELCAST) render demo:interior --technique surfel --size 480x270 --spp 4
# Where benchmarks leave JSON, CSV and plots, and continue after an interrupt; remove it to start from nothing.
BENCH_OUT ?= target/bench
BENCH_ARGS := --out $(BENCH_OUT) --docs docs/bench
# Seconds of other renderers: rows of their harness, then its stated tables.
PEERS ?= $(wildcard $(addprefix $(or $(SURFELCAST_SHARED),../shared)/peers/,results.csv RESULTS.md))

# Targets with their explanations, without those in brackets; the argument is a sed command that leaves some out.
list = sed -nE '$(1) s/^([a-z-]+):[^\#]*\#\# ([^(].*)/make \1|\2/p' Makefile | \
	while IFS='|' read -r name text; do printf '  %-27s %s\n' "$$name" "$$text"; done

.PHONY: help
help: ## Show these commands
	@$(call list,/build-bench/d;)

.PHONY: help-bench
help-bench: ## Show the benchmarks
	@$(call list,/: build-bench/!d;)

.PHONY: deps
deps: ## Install what building and serving needs
	@deploy/install-deps.sh

.PHONY: deps-tests
deps-tests: ## (for tests) Install what the tests need as well
	@deploy/install-deps.sh --tests

.PHONY: build
build: deps ## Compile the server (target/release/surfelcast)
	$(CARGO) build --release --locked --package surfelcast

.PHONY: build-bench
build-bench: deps ## (for benchmarks) Compile the server and the laboratory (target/release/surfelcast-bench)
	$(CARGO) build --release --locked --package surfelcast --package surfelcast-bench

.PHONY: serve
serve: deps ## Compile and run the server with the demo scenes; ARGS="--bind 0.0.0.0:8080 --scene my.glb" to change that
	$(CARGO) run --release --locked --package surfelcast -- serve $(ARGS)

.PHONY: test
test: deps-tests ## Run every test: format, lints, Rust, browser client, browser against server
	@tests/run-all.sh

.PHONY: check
check: deps-tests ## Format, lints, documentation and types; runs no test
	$(CARGO) fmt --all --check
	$(CARGO) clippy --release --locked --workspace --all-targets -- --deny warnings
	RUSTDOCFLAGS="--deny warnings" $(CARGO) doc --release --locked --workspace --no-deps
	cd web-client && npm run check

# Benchmarks. Each continues what an earlier run left in $(BENCH_OUT), and writes its page in docs/bench.

.PHONY: bench
bench: build-bench ## Rays per second against a CPU traversal of the same hierarchy
	$(BENCH) rays $(BENCH_ARGS) $(ARGS)

.PHONY: bench-accuracy
bench-accuracy: build-bench ## Error of every reference camera
	$(BENCH) accuracy $(BENCH_ARGS) $(ARGS)

.PHONY: bench-surfels
bench-surfels: build-bench ## Error of the surfel cache against references and path tracing
	$(BENCH) surfels $(BENCH_ARGS) $(ARGS)

.PHONY: bench-error
bench-error: build-bench ## Error against seconds and rays of every technique
	$(BENCH) error $(BENCH_ARGS) $(ARGS)

.PHONY: bench-presets
bench-presets: build-bench ## Error and time of the presets of the surfel cache
	$(BENCH) presets $(BENCH_ARGS) $(ARGS)

.PHONY: bench-densities
bench-densities: build-bench ## Error by capacity and density of surfels
	$(BENCH) densities $(BENCH_ARGS) $(ARGS)

.PHONY: bench-peers
bench-peers: build-bench ## Seconds to an error next to other renderers; PEERS="results.csv ..."
	$(BENCH) peers $(addprefix --peers ,$(PEERS)) $(BENCH_ARGS) $(ARGS)

.PHONY: bench-settling
bench-settling: build-bench ## Error of an image that converges to the path-traced one
	$(BENCH) settling $(BENCH_ARGS) $(ARGS)

.PHONY: bench-settling-small
bench-settling-small: build-bench ## The same in small images of every reference
	$(BENCH) settling-small $(BENCH_ARGS) $(ARGS)

.PHONY: bench-reconstructions
bench-reconstructions: build-bench ## Error of reconstructions and of path tracing at equal rays
	$(BENCH) reconstructions $(BENCH_ARGS) $(ARGS)

.PHONY: bench-image
bench-image: build-bench ## Error of indirect light reconstructed in the image, by scheme
	$(BENCH) image --truth-spp 512 $(BENCH_ARGS) $(ARGS)

.PHONY: bench-scale
bench-scale: build-bench ## Time and memory against triangles and surfels
	$(BENCH) scale $(BENCH_ARGS) $(ARGS)

.PHONY: bench-poisson
bench-poisson: build-bench ## Convergence of Poisson solvers
	$(BENCH) poisson $(BENCH_ARGS) $(ARGS)

.PHONY: bench-apply
bench-apply: build-bench ## Time of gathering and of drawing surfels for the thesis' surfel counts
	$(BENCH) apply $(BENCH_ARGS) $(ARGS)

.PHONY: bench-locality
bench-locality: build-bench ## Distance in memory between the surfels of neighbouring pixels
	$(BENCH) locality $(BENCH_ARGS) $(ARGS)

.PHONY: bench-all
bench-all: build-bench ## Every page, one after the other; takes hours
	@for name in bench bench-accuracy bench-surfels bench-error bench-presets bench-densities bench-peers bench-settling bench-settling-small bench-reconstructions bench-image bench-scale bench-poisson bench-apply bench-locality; do $(MAKE) $$name || exit 1; done

.PHONY: film-strips
film-strips: build-bench ## Frames of the surfel cache in motion, as docs/strip-*.jpg
	$(BENCH) strips docs $(ARGS)

.PHONY: docs-images
docs-images: deps-tests build ## Screenshots of the page and renders of the demo scenes, written into docs/
	cd tests/browser && node docs-images.js
	$(SURFELCAST) render demo:interior --camera "living room" --size 960x540 --spp $(DOCS_SPP) --output docs/living-room.jpg
	$(SURFELCAST) render demo:interior --camera kitchen --size 960x540 --spp $(DOCS_SPP) --output docs/kitchen.jpg
	$(SURFELCAST) render demo:interior --camera "still life" --size 960x540 --spp $(DOCS_SPP) --output docs/still-life.jpg
	$(SURFELCAST) render demo:cornell_box --size 512x512 --spp $(DOCS_SPP) --output docs/cornell-box.jpg
	for name in none regression poisson image; do $(DOCS_EARLY) --reconstruction $$name --output docs/reconstruction-$$name.jpg || exit 1; done
	$(DOCS_EARLY) --reconstruction image --set image=unscreened --output docs/reconstruction-published.jpg

.PHONY: deny
deny: ## Licences, bans, sources and advisories of all dependencies (needs cargo-deny)
	@$(CARGO) deny --version >/dev/null 2>&1 || { echo "cargo-deny is not installed: cargo install --locked cargo-deny" >&2; exit 2; }
	$(CARGO) deny --workspace --all-features check

.PHONY: clean
clean: ## Remove everything that was built or fetched
	$(CARGO) clean
	rm -rf web-client/node_modules tests/browser/node_modules
