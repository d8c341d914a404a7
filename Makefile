# envsamp.h: see `make help`. Nothing here is needed to use the header.

CC       ?= cc
CXX      ?= c++
CFLAGS   ?= -O2
BUILD    := build
DATA     := data

STRICT   := -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion \
            -Wdouble-promotion -Wcast-qual
STRICT_C := $(STRICT) -Wstrict-prototypes -Wmissing-prototypes
COMPILE   = $(CC) -std=c99 $(CFLAGS) $(STRICT_C) -I. -Iexamples/common

EXR_CFLAGS = -DHAVE_OPENEXR $(shell pkg-config --cflags OpenEXR 2>/dev/null)
EXR_LIBS   = $(shell pkg-config --libs OpenEXR 2>/dev/null)

COMMON   := examples/common/image.c examples/common/maps.c
DEMO     := examples/demo.c examples/common/picture.c bench/baselines.c
HEADERS  := envsamp.h $(wildcard examples/common/*.h tests/*.h bench/*.h)
TESTS    := $(patsubst tests/%.c,$(BUILD)/%,$(wildcard tests/test_*.c))
TEST_AID := $(filter-out $(wildcard tests/test_*.c),$(wildcard tests/*.c))
SCRIPTS  := $(wildcard tests/test_*.sh)

.PHONY: help demo test bench figures data setup clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-10s %s\n", $$1, $$2}' Makefile

# A real map needs the build that reads EXR, which needs libopenexr.
ifdef ENV
demo: setup $(BUILD)/demo_exr  ## sample made-up maps and draw pictures; ENV=file.exr: that map
	$(BUILD)/demo_exr -o $(BUILD)/pictures $(ENV)
else
demo: $(BUILD)/demo
	$(BUILD)/demo -o $(BUILD)/pictures
endif

test: setup $(TESTS) $(BUILD)/quickstart $(BUILD)/demo_exr  ## build and run all tests
	CC="$(CC)" CXX="$(CXX)" prove --timer --exec '' $(TESTS) $(SCRIPTS)

# MAP: sky, studio, constant, night, foliage, or a file; made or enlarged to a width of 2048.
bench: $(BUILD)/bench  ## time sampling, pdf and builds against other samplers; MAP=name or file
	$(BUILD)/bench $(MAP)

figures: $(BUILD)/figures  ## variance, fits and distributions over the real maps
	$(BUILD)/figures

data: setup $(BUILD)/exr_to_pfm  ## fetch 18 real maps into data/
	sh examples/common/fetch_data.sh $(DATA) $(BUILD)/exr_to_pfm

setup:  ## install libopenexr-dev and libembree-dev where they are missing
	@sh tests/setup.sh

clean:  ## remove what was built; data/ stays
	rm -rf $(BUILD)

$(BUILD):
	@mkdir -p $@

$(BUILD)/demo: $(DEMO) $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) $(DEMO) $(COMMON) -lm -o $@

$(BUILD)/demo_exr: $(DEMO) $(COMMON) examples/common/exr.c $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) $(DEMO) $(COMMON) examples/common/exr.c $(EXR_LIBS) -lm -o $@

$(BUILD)/quickstart: examples/quickstart.c $(HEADERS) | $(BUILD)
	$(COMPILE) examples/quickstart.c -lm -o $@

$(BUILD)/exr_to_pfm: examples/common/exr_to_pfm.c examples/common/image.c examples/common/exr.c \
                     $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) examples/common/exr_to_pfm.c examples/common/image.c \
	    examples/common/exr.c $(EXR_LIBS) -lm -o $@

$(BUILD)/bench: bench/bench.c bench/baselines.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) -DBENCH_FLAGS='"$(CFLAGS)"' bench/bench.c bench/baselines.c $(COMMON) -lm -o $@

$(BUILD)/figures: bench/figures.c $(COMMON) $(HEADERS) | $(BUILD)
	$(COMPILE) bench/figures.c $(COMMON) -lm -o $@

$(BUILD)/test_%: tests/test_%.c $(TEST_AID) $(COMMON) examples/common/exr.c $(HEADERS) | $(BUILD)
	$(COMPILE) $(EXR_CFLAGS) $< $(TEST_AID) $(COMMON) examples/common/exr.c $(EXR_LIBS) -lm -o $@
