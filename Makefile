# envsamp.h: see `make help`. Nothing here is needed to use the header.

CC       ?= cc
CXX      ?= c++
CFLAGS   ?= -O2
BUILD    := build
DATA     := data

STRICT   := -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion \
            -Wdouble-promotion -Wcast-qual
STRICT_C := $(STRICT) -Wstrict-prototypes -Wmissing-prototypes
# V=1 shows the commands.
SAY       = $(if $(V),,@echo "  $(notdir $@)";)
COMPILE   = $(SAY)$(CC) -std=c99 $(CPPFLAGS) $(CFLAGS) $(STRICT_C) -I. -Iexamples/common
LINK      = $(SAY)$(CC) $(CFLAGS)
LIBM      = $(LDFLAGS) -lm
PREFIX   ?= /usr/local

# A file or a name of a made-up map, for every target that takes one.
MAP_WORD  = $(if $(MAP),"$(MAP)")

# Elsewhere than on x86 bench_batch says that it is skipped.
AVX2        := $(shell $(CC) -mavx2 -E -x c /dev/null >/dev/null 2>&1 && echo -mavx2)
BATCH_FLAGS := -O3 $(AVX2)

# Programs that show a table of an older version take its header.
OTHER_HEADER = $(if $(HEADER),-DHEADER='"$(abspath $(HEADER))"')

HAVE_EXR   = $(shell pkg-config --exists OpenEXR 2>/dev/null && echo yes)
EXR_CFLAGS = $(if $(HAVE_EXR),-DHAVE_OPENEXR $(shell pkg-config --cflags OpenEXR))
EXR_LIBS   = $(if $(HAVE_EXR),$(shell pkg-config --libs OpenEXR))

# The renderer, built and tested where Embree is.
EMBREE       := $(firstword $(foreach version,3 4,$(if $(wildcard \
                  /usr/include/embree$(version)/rtcore.h),embree$(version))))
RENDER_LIBS   = -l$(or $(EMBREE),embree3) $(EXR_LIBS) -pthread $(LIBM)
RENDER_PARTS := scene shapes material environment inversion integrator lights upsample product tiles

# Tables on a GPU, built and tested where EGL and OpenGL ES 3.1 are.
HAVE_EGL = $(and $(wildcard /usr/include/EGL/egl.h),$(wildcard /usr/include/GLES3/gl31.h))
NVCC    := $(firstword $(wildcard $(shell command -v nvcc 2>/dev/null) /usr/local/cuda/bin/nvcc))
GPU_LIBS = -lEGL -lGLESv2 $(LIBM)

COMMON   := $(addprefix examples/common/, image.c hdr.c maps.c)
EXAMPLES := $(addprefix $(BUILD)/, quickstart path_tracer lights halftone table_file placement \
              engine sun_and_sky lights_gallery facing_gallery product_gallery demo_exr samplers \
              $(if $(EMBREE),render render_unbiased render_tables) $(if $(HAVE_EGL),gpu_check))
TIMED    := bench/baselines.c bench/input.c
PLOTTED  := bench/baselines.c bench/plot.c examples/common/picture.c
HEADERS  := envsamp.h $(wildcard $(addsuffix /*.h, examples/common examples/engine \
              examples/render tests bench))
TESTS    := $(patsubst tests/%.c,$(BUILD)/%,$(wildcard tests/test_*.c))
SCRIPTS  := $(wildcard tests/test_*.sh)
# The longest first, so that all cores end together.
LONGEST  := $(addprefix tests/test_, sanitize.sh compile.sh numbers.sh render.sh bits.sh fast_math.sh \
              stack.sh gpu.sh) \
            $(addprefix $(BUILD)/test_, lights_lamps kd_statistics kd_fit halftone cdf kd_warp \
              kd_exact kd_facing kd_table bilinear coarse lights_cuts lights lights_decomposed \
              kd_layout steps mapping placement)
ORDERED  := $(filter $(TESTS) $(SCRIPTS),$(LONGEST)) $(filter-out $(LONGEST),$(TESTS) $(SCRIPTS))
JOBS     ?= $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 1)

# Compiled once: what examples link, what the demo and tests do, which read EXR files, and tests.
OBJECTS      = $(addprefix $(BUILD)/, envsamp.o image.o hdr.o maps.o picture.o)
EXR_OBJECTS  = $(addprefix $(BUILD)/, envsamp.o image_exr.o hdr.o maps.o picture.o \
                 $(if $(HAVE_EXR),exr.o))
RENDER_OBJECTS = $(patsubst %,$(BUILD)/render_%.o,$(RENDER_PARTS)) $(EXR_OBJECTS)
TEST_OBJECTS = $(addprefix $(BUILD)/, inside.o statistics.o errors.o filtered.o) $(EXR_OBJECTS)

.PHONY: help demo check install lights sun-and-sky engine facing product render unbiased gallery \
        tables test bench lines samplers scale fuzz corpus mutants coverage figures facing-table \
        convergence halftone scene lamps coarse shapes builds targets importance least-squares \
        left-out again numbers portability portability-setup gpu gpu-bench data setup clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-18s %s\n", $$1, $$2}' Makefile

# An EXR file takes the build that reads it, and libopenexr, which setup installs. Two made-up maps
# go side by side.
ifneq ($(filter %.exr,$(MAP)),)
demo: setup
	@$(MAKE) --no-print-directory -j$(JOBS) $(BUILD)/demo_exr
	$(BUILD)/demo_exr -o $(BUILD)/pictures $(MAP_WORD)
else
demo:  ## sample made-up maps and draw pictures; MAP=file: that map
	@$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$(JOBS)) $(BUILD)/demo
ifdef MAP
	$(BUILD)/demo -o $(BUILD)/pictures $(MAP_WORD)
else
	$(BUILD)/demo -o $(BUILD)/pictures studio >$(BUILD)/demo_studio.txt & \
	    $(BUILD)/demo -o $(BUILD)/pictures sky; sky=$$?; \
	    wait $$! && cat $(BUILD)/demo_studio.txt && exit $$sky
endif
endif

# PROVE TESTS: runs them; what failed comes at once, and again behind the summary.
define PROVE
	@rm -f $(BUILD)/failures.txt
	@{ CC="$(CC)" CXX="$(CXX)" prove -j$(JOBS) $1 --exec '' $2; echo $$? >$(BUILD)/status.txt; } \
	    3>&1 2>&1 1>&3 | tee $(BUILD)/failures.txt >&2
	@grep '^#' $(BUILD)/failures.txt >&2; exit $$(cat $(BUILD)/status.txt)
endef

# What a contributor needs to know at once, in two minutes on two cores. No packages.
CHECKED = $(addprefix tests/test_, sections.sh snippets.sh) \
          $(addprefix $(BUILD)/test_, kd_exact kd_warp kd_target cdf mapping bilinear faults zero \
            steps lights halftone lm common hdr errors)
check:  ## the tests that most changes need, in two minutes
	@$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$(JOBS)) \
	    $(filter $(BUILD)/%,$(CHECKED))
	$(call PROVE,,$(filter $(CHECKED),$(ORDERED)))

# As many jobs at a time as there are cores, unless JOBS or -j says otherwise.
test: setup  ## build and run all tests
	@$(MAKE) --no-print-directory $(if $(filter -j%,$(MAKEFLAGS)),,-j$(JOBS)) $(TESTS) $(EXAMPLES)
	$(call PROVE,--timer,$(ORDERED))

lights: $(BUILD)/lights_gallery  ## a map as lights, and pictures; MAP=file, LIGHTS="-k 64"
	$(BUILD)/lights_gallery -o $(BUILD)/pictures $(LIGHTS) $(MAP_WORD)

sun-and-sky: $(BUILD)/sun_and_sky  ## a map as directional lights and the rest of it; MAP=file
	$(BUILD)/sun_and_sky $(or $(MAP_WORD),sky)

# ENGINE="--size 4096x2048 --frames 600"; build/engine --help shows all options.
engine: $(BUILD)/engine  ## a frame loop: tables in steps as the sun moves; ENGINE=options
	$(BUILD)/engine $(ENGINE)
	$(if $(ENGINE),,$(BUILD)/engine --half)
	$(if $(ENGINE),,$(BUILD)/engine --size 512x256 --blocks 256 --budget-ms 4)

facing: $(BUILD)/facing_gallery  ## light x cosine beside light and MIS, and a picture; MAP=file
	$(BUILD)/facing_gallery -o $(BUILD)/pictures $(MAP_WORD)

product: $(BUILD)/product_gallery  ## product sampling by halftones beside BRDF and SIR, a picture
	$(BUILD)/product_gallery -o $(BUILD)/pictures $(PRODUCT) $(MAP_WORD)

# RENDER="--scene chrome --spp 256"; build/render --help shows all options.
render: setup  ## a scene under a map, by Embree, and its picture; MAP=file, RENDER=options
	@$(MAKE) --no-print-directory $(BUILD)/render
	@mkdir -p $(BUILD)/pictures
	$(BUILD)/render --out $(BUILD)/pictures/render.png $(if $(MAP),--env $(MAP_WORD)) \
	    $(RENDER)

# A quarter of an hour on two cores. tests/test_render.sh has a short one.
unbiased: setup  ## every sampling method of the renderer beside a reference, at 1024 samples
	@$(MAKE) --no-print-directory $(BUILD)/render_unbiased
	$(BUILD)/render_unbiased -t $(JOBS) 1024

left-out: | $(BUILD)  ## compile time and text of the header, whole and with parts left out
	@for part in "" NO_LIGHTS NO_CDF NO_FIT "NO_LIGHTS NO_CDF NO_FIT"; do \
	    flags=; for one in $$part; do flags="$$flags -DENVSAMP_$$one"; done; \
	    start=$$(date +%s%N); \
	    $(CC) -std=c99 $(CFLAGS) -DENVSAMP_IMPLEMENTATION $$flags -x c -c envsamp.h \
	        -o $(BUILD)/left_out.o || exit 1; \
	    printf '%-24s %5d ms %7s bytes of text\n' "$${part:-all}" \
	        $$((($$(date +%s%N) - start) / 1000000)) \
	        "$$(size $(BUILD)/left_out.o | awk 'NR == 2 { print $$1 }')"; \
	done

# The real maps, where make data has fetched them.
gallery: setup  ## every picture of the README, in build/pictures
	@$(MAKE) --no-print-directory $(addprefix $(BUILD)/, strip ward demo lights_gallery \
	    facing_gallery product_gallery convergence)
	@mkdir -p $(BUILD)/pictures $(BUILD)/references
	$(BUILD)/strip -t $(JOBS) $(MAP_WORD)
	$(BUILD)/ward -t $(JOBS)
	$(BUILD)/demo -o $(BUILD)/pictures
	$(BUILD)/lights_gallery -k 32 -o $(BUILD)/pictures sky
	$(BUILD)/facing_gallery -o $(BUILD)/pictures
	$(BUILD)/product_gallery -o $(BUILD)/pictures
	$(BUILD)/demo -o $(BUILD)/pictures $(DATA)/city.pfm
	$(BUILD)/convergence -o $(BUILD)/pictures/convergence.png

# TABLES="samplers calls": only these. What is done is kept; an hour and a half on two cores.
tables: setup  ## all samplers and lights in the renderer, over the real maps: bench/results
	@$(MAKE) --no-print-directory $(BUILD)/render_tables
	$(BUILD)/render_tables -t $(JOBS) $(TABLES)

# MAP: sky, studio, constant, night, foliage, or an HDR or PFM file; enlarged to 2048.
# CHECK=1, here and elsewhere: what is promised of the figures, and where it is MISSED.
bench: $(addprefix $(BUILD)/, bench cold bench_batch)  ## time it against other samplers; MAP=file
	$(BUILD)/bench $(MAP_WORD)
	$(BUILD)/cold $(MAP_WORD)
	$(BUILD)/bench_batch $(MAP_WORD)

samplers: $(BUILD)/samplers  ## every kind of table: bytes, times, variance, MIS; MAP=file
	$(BUILD)/samplers $(MAP_WORD)

# Needs valgrind. MAP: as for bench.
lines: $(BUILD)/lines  ## cache lines of its table that a sample and a density touch; MAP=file
	$(BUILD)/lines $(MAP_WORD)

scale: $(BUILD)/scale  ## large maps by row callback, and builds in steps
	$(BUILD)/scale $(MAP_WORD)

# SECONDS is for each of the targets build, steps, open, lights, halftone, lm and hdr, of which two
# run at a time; TARGETS="open lm": only these. It needs clang with libFuzzer.
fuzz:  ## builds, damaged tables, lights, .hdr files under libFuzzer; SECONDS=60 for each of 7
	sh tests/fuzz.sh $(or $(SECONDS),60) $(TARGETS)

corpus: $(BUILD)/test_fuzz  ## write tests/corpus again, from fixed seeds
	mkdir -p $(addprefix tests/corpus/, build steps open lights halftone lm)
	$(BUILD)/test_fuzz corpus tests/corpus

# See tests/mutants.pl. Half an hour; FAULTS="1x1 alias": only those of the list with one of these
# words, some minutes. SECTIONS="cdf lm": those drawn are of these sections.
mutants:  ## put faults in, see tests fail: a list, then COUNT=200 drawn from SEED=1
	CC="$(CC)" perl tests/mutants.pl $(FAULTS)
ifndef FAULTS
	CC="$(CC)" perl tests/mutants.pl -a $(or $(COUNT),200) -s $(or $(SEED),1) $(SECTIONS)
endif

# Needs clang and its llvm-cov and llvm-profdata. Some minutes. See tests/coverage.pl.
coverage: setup  ## lines and branches of envsamp.h that the tests reach, by function
	perl tests/coverage.pl

# Some minutes. ROWS='arm|wasm': those that grep -E finds; JOBS=1: one at a time.
portability:  ## compilers x machines x standards: the same bits, in one table
	sh tests/portability.sh $(if $(ROWS),'$(ROWS)')

portability-setup:  ## install the compilers and emulators for it that Debian has
	@sh tests/setup_portability.sh

# LONG=: the long commands too, hours; LONG=word: those with this word.
SHORT = $(addprefix $(BUILD)/, samplers facing_gallery product_gallery)
numbers: $(SHORT)  ## the numbers of the README files, printed again and compared
	perl tests/numbers.pl $(if $(filter undefined,$(origin LONG)),,-l $(LONG))

# Without a GPU Mesa computes, half an hour on two cores. POINTS=100000: fewer than 10^6.
gpu:  ## tables sampled in GLSL, HLSL and WGSL beside C, over made-up and real maps
	@sh tests/setup_gpu.sh $(BUILD)
	@$(MAKE) --no-print-directory $(BUILD)/gpu_check
	sh examples/gpu/check.sh $(BUILD) $(or $(POINTS),1000000) $(wildcard $(DATA)/*.pfm)

gpu-bench: $(if $(NVCC),$(BUILD)/gpu_bench)  ## samples a second on a CUDA device; MAP=file
	@$(if $(NVCC),$(BUILD)/gpu_bench $(MAP_WORD),echo "samples a second: not measured, no nvcc")

figures: $(BUILD)/figures  ## variance, fits and inverses over the real maps; POINTS=10000000
	$(BUILD)/figures $(POINTS)

convergence: $(BUILD)/convergence  ## error of irradiance over the number of samples, and a plot
	@mkdir -p $(BUILD)/pictures
	$(BUILD)/convergence -o $(BUILD)/pictures/convergence.png

# MAP: of the times, as for bench.
facing-table: $(BUILD)/facing_table  ## light x cosine over the real maps, and its times; MAP=file
	$(BUILD)/facing_table $(MAP_WORD)

halftone: $(BUILD)/halftone_table  ## error diffusion: evenness, irradiance, counts, time
	$(BUILD)/halftone_table

scene: $(BUILD)/scene $(BUILD)/light_sets  ## a map as 16 to 64 lights, by every method, in scenes
	$(BUILD)/scene
	$(BUILD)/light_sets

# HEADER=old/envsamp.h: of another version, for this and the next.
lamps: $(BUILD)/lamps  ## RELAXED on maps of strong lamps, beside cuts and DECOMPOSED
	$(BUILD)/lamps table

coarse: $(BUILD)/coarse  ## how bright a sky is with numbers of few bits, by every sampler
	$(BUILD)/coarse

shapes: $(BUILD)/shapes  ## what builds of long maps take, beside those of as many texels at 2:1
	$(BUILD)/shapes

builds: $(BUILD)/builds  ## what builds take and give over the real maps, beside HEADER= if given
	$(BUILD)/builds

targets: $(BUILD)/targets  ## blocks, bytes and time for targets of excess variance, real maps
	$(BUILD)/targets

importance: $(BUILD)/importance  ## exponent x compensation x facing under MIS, over the real maps
	$(BUILD)/importance

least-squares: $(BUILD)/least-squares  ## envsamp_lm on 400 problems of all scales
	$(BUILD)/least-squares table

data: setup $(BUILD)/exr_to_pfm  ## fetch 18 real maps into data/
	sh examples/common/fetch_data.sh $(DATA) $(BUILD)/exr_to_pfm

install:  ## envsamp.h and a pkg-config file, to PREFIX=/usr/local
	install -d "$(DESTDIR)$(PREFIX)/include" "$(DESTDIR)$(PREFIX)/share/pkgconfig"
	install -m 644 envsamp.h "$(DESTDIR)$(PREFIX)/include"
	printf '%s\n' 'prefix=$(PREFIX)' 'Name: envsamp' 'Version: 0.2.0' \
	    'Description: importance sampling of environment maps' 'Cflags: -I$${prefix}/include' \
	    'Libs: -lm' >"$(DESTDIR)$(PREFIX)/share/pkgconfig/envsamp.pc"

setup:  ## install libopenexr-dev and libembree-dev where they are missing
	@sh tests/setup.sh

clean:  ## remove what was built; data/ stays
	rm -rf $(BUILD)

.SECONDARY:

$(BUILD):
	@mkdir -p $@

$(BUILD)/%.o: tests/%.c $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) -c $< -o $@

$(BUILD)/%.o: examples/common/%.c $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) -c $< -o $@

$(BUILD)/render_%.o: examples/render/%.c $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) -pthread -c $< -o $@

$(BUILD)/render: examples/render/render.c $(RENDER_OBJECTS) $(HEADERS)
	$(COMPILE) -DENVSAMP_IMPLEMENTED $(EXR_CFLAGS) $< $(RENDER_OBJECTS) $(RENDER_LIBS) -o $@

$(BUILD)/render_unbiased: $(BUILD)/render_unbiased.o $(RENDER_OBJECTS)
	$(LINK) $^ $(RENDER_LIBS) -o $@

$(BUILD)/strip $(BUILD)/ward: $(BUILD)/%: bench/%.c bench/stage.c $(BUILD)/errors.o \
                              $(BUILD)/filtered.o $(RENDER_OBJECTS) $(HEADERS)
	$(COMPILE) $(filter %.c %.o,$^) $(RENDER_LIBS) -o $@

TABLE_FLAGS   = -DBENCH_FLAGS='"$(CFLAGS)"' -DBENCH_COMMIT='"$(shell git describe --always --dirty \
                  2>/dev/null || echo unknown)"'
TABLE_SOURCES = $(addprefix bench/, render_tables.c render_report.c stage.c cells.c)
TABLE_OBJECTS = $(addprefix $(BUILD)/, render_rivals.o errors.o filtered.o) $(RENDER_OBJECTS)
$(BUILD)/render_tables: $(TABLE_SOURCES) $(TABLE_OBJECTS) $(HEADERS)
	$(COMPILE) $(TABLE_FLAGS) $(TABLE_SOURCES) $(TABLE_OBJECTS) $(RENDER_LIBS) -o $@

$(BUILD)/image.o: examples/common/image.c $(HEADERS) | $(BUILD)
	$(COMPILE) -c $< -o $@

$(BUILD)/image_exr.o: examples/common/image.c $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) -c $< -o $@

# An example is a program with the library in it; here it takes the one that is compiled already.
$(BUILD)/%: examples/%.c $(OBJECTS) $(HEADERS)
	$(COMPILE) -DENVSAMP_IMPLEMENTED $< $(OBJECTS) $(LIBM) -o $@

$(BUILD)/engine: $(wildcard examples/engine/*.c) $(HEADERS) | $(BUILD)
	$(COMPILE) -pthread $(filter %.c,$^) $(LIBM) -o $@

$(BUILD)/%_gallery: bench/%_gallery.c $(OBJECTS) $(HEADERS)
	$(COMPILE) -DENVSAMP_IMPLEMENTED $< $(OBJECTS) $(LIBM) -o $@

$(BUILD)/demo: bench/demo.c $(BUILD)/baselines.o $(OBJECTS) $(HEADERS)
	$(COMPILE) -DENVSAMP_IMPLEMENTED $< $(BUILD)/baselines.o $(OBJECTS) $(LIBM) -o $@

$(BUILD)/samplers: bench/samplers.c $(BUILD)/baselines.o $(OBJECTS) $(HEADERS)
	$(COMPILE) -DENVSAMP_IMPLEMENTED $< $(BUILD)/baselines.o $(OBJECTS) $(LIBM) -o $@

$(BUILD)/demo_exr: bench/demo.c $(BUILD)/baselines.o $(EXR_OBJECTS) $(HEADERS)
	$(COMPILE) -DENVSAMP_IMPLEMENTED $(EXR_CFLAGS) $< $(BUILD)/baselines.o $(EXR_OBJECTS) \
	    $(EXR_LIBS) $(LIBM) -o $@

$(BUILD)/gpu_check: $(addprefix examples/gpu/, check.c gpu.c gpu.h) \
                    $(addprefix $(BUILD)/, image.o hdr.o maps.o) $(HEADERS)
	$(COMPILE) $(filter %.c %.o,$^) $(GPU_LIBS) -o $@

$(BUILD)/gpu_bench: bench/gpu.cu $(addprefix $(BUILD)/, baselines.o image.o hdr.o maps.o) \
                    $(HEADERS)
	$(SAY)$(or $(NVCC),nvcc) -O3 -I. $(filter %.cu %.o,$^) -o $@

# Alone, as a user has it.
$(BUILD)/quickstart: $(addprefix examples/, quickstart.c common/image.c common/hdr.c) $(HEADERS) \
                      | $(BUILD)
	$(COMPILE) $(filter %.c,$^) $(LIBM) -o $@

$(BUILD)/exr_to_pfm: $(addprefix examples/common/, exr_to_pfm.c image.c hdr.c exr.c) $(HEADERS) \
                     | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) $(filter %.c,$^) $(EXR_LIBS) $(LIBM) -o $@

$(BUILD)/bench: bench/bench.c $(TIMED) $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/bench.c $(TIMED) $(COMMON) $(LIBM) -o $@

$(BUILD)/cold: bench/cold.c $(TIMED) $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/cold.c $(TIMED) $(COMMON) $(LIBM) -o $@

$(BUILD)/lines: bench/lines.c $(TIMED) $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) bench/lines.c $(TIMED) $(COMMON) $(LIBM) -o $@

$(BUILD)/scale: bench/scale.c bench/input.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/scale.c bench/input.c $(COMMON) $(LIBM) -o $@

# The library with AVX2 beside a scalar baseline that is compiled as everything else is.
$(BUILD)/baselines.o: bench/baselines.c $(HEADERS) | $(BUILD)
	$(COMPILE) -O2 -c bench/baselines.c -o $@

$(BUILD)/bench_batch: bench/bench_batch.c bench/input.c $(BUILD)/baselines.o $(COMMON) $(HEADERS)
	$(COMPILE) $(BATCH_FLAGS) -DBENCH_FLAGS='"$(BATCH_FLAGS)"' bench/bench_batch.c bench/input.c \
	    $(BUILD)/baselines.o $(COMMON) $(LIBM) -o $@

$(BUILD)/convergence: bench/convergence.c $(PLOTTED) $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) bench/convergence.c $(PLOTTED) $(COMMON) $(LIBM) -o $@

$(BUILD)/facing_table: bench/facing.c $(TIMED) $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/facing.c $(TIMED) $(COMMON) \
	    $(LIBM) -o $@

$(BUILD)/halftone_table: bench/halftone.c bench/baselines.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/halftone.c bench/baselines.c \
	    $(COMMON) $(LIBM) -o $@

$(BUILD)/scene: bench/lights.c bench/baselines.c examples/render/rivals.c $(COMMON) $(HEADERS) \
                | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' $(filter %.c,$^) $(LIBM) -o $@

$(BUILD)/light_sets: bench/light_sets.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) bench/light_sets.c $(COMMON) $(LIBM) -o $@

# Made again each time: one does not see of which header they are.
$(BUILD)/coarse: tests/coarse.c
$(BUILD)/shapes: bench/shapes.c
$(BUILD)/coarse $(BUILD)/shapes: $(COMMON) $(HEADERS) again | $(BUILD)
	$(COMPILE) $(OTHER_HEADER) $(filter %.c,$^) $(LIBM) -o $@

# Two versions in one program, if HEADER names another.
VERSION = $(SAY)$(CC) -std=c99 $(CFLAGS) -I. bench/builds_version.c
$(BUILD)/builds: bench/builds.c bench/builds_version.c $(TIMED) $(COMMON) $(OBJECTS) $(HEADERS) \
                 again
	$(VERSION) -DVERSION=builds_now -c -o $(BUILD)/builds_now.o
	$(if $(HEADER),$(VERSION) -w $(OTHER_HEADER) -DVERSION=builds_before -c \
	    -o $(BUILD)/builds_before.o)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' $(if $(HEADER),-DWITH_BEFORE) bench/builds.c $(TIMED) \
	    $(COMMON) $(BUILD)/builds_now.o $(if $(HEADER),$(BUILD)/builds_before.o) \
	    $(BUILD)/envsamp.o $(LIBM) -o $@

$(BUILD)/importance: bench/importance.c examples/common/picture.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) bench/importance.c examples/common/picture.c $(COMMON) $(LIBM) -o $@

$(BUILD)/targets: bench/targets.c bench/input.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/targets.c bench/input.c $(COMMON) \
	    $(LIBM) -o $@

$(BUILD)/least-squares: tests/test_lm_scales.c
$(BUILD)/lamps: tests/test_lights_lamps.c $(COMMON)
$(BUILD)/least-squares $(BUILD)/lamps: $(HEADERS) again | $(BUILD)
	$(COMPILE) -DENVSAMP_IMPLEMENTATION $(OTHER_HEADER) $(filter %.c,$^) $(LIBM) -o $@

$(BUILD)/figures: tests/figures.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) tests/figures.c tests/inside.c $(COMMON) $(LIBM) -o $@

$(BUILD)/test_fuzz.o: tests/fuzz.c

$(BUILD)/test_material: $(BUILD)/render_material.o

$(BUILD)/test_rivals: $(BUILD)/render_rivals.o

# It counts calls of functions, in a copy of the library that is its own.
$(BUILD)/test_work.o: override CFLAGS += -finstrument-functions

$(BUILD)/test_%: $(BUILD)/test_%.o $(TEST_OBJECTS)
	$(LINK) $^ $(EXR_LIBS) $(LIBM) -o $@
