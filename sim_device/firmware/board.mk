# The firmware for its chips. Needs Debian's gcc-arm-none-eabi and libnewlib-arm-none-eabi.
#   make -f board.mk            the boards' programs and their size, in build/
#   make -f board.mk build/board_f429.elf build/board_f429.bin
# BUILD, WIRE (folder of the generated codec) and PYTHON can be given; the project's own Makefile
# has a target for it: make firmware.

BUILD ?= build
WIRE ?= $(BUILD)/wire
PYTHON ?= python3
CROSS ?= arm-none-eabi-
CPPCHECK ?= cppcheck
BOARDS := board_f405_qemu board_f429 board_nucleo_f429zi
CHIP_board_f429 := stm32f429
CHIP_board_nucleo_f429zi := stm32f429
HERE := $(dir $(abspath $(lastword $(MAKEFILE_LIST))))

# A board of one device has no use for the parameter `board`.
CFLAGS := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 \
	-std=c99 -Os -ffunction-sections -fdata-sections -fno-common -ffp-contract=off \
	-Wall -Wextra -Wconversion -Werror -Wshadow -Wstrict-prototypes -Wmissing-prototypes \
	-Wdouble-promotion -Wundef -Wvla -Wno-unused-parameter \
	-fstack-usage -fcallgraph-info=su
# No heap, no system calls: what would need them does not link.
LDFLAGS := -nostartfiles --specs=nano.specs -Wl,--gc-sections -Wl,--fatal-warnings -L board_common
INCLUDES := -Iinclude -Icore -Iboard_common -I$(WIRE)

CORE := $(wildcard core/*.c) board_common/startup.c
# The codec, with the chip's CRC unit where there is one.
CONFIG_board_f429 := -DSP_CRC_UNIT
CONFIG_board_nucleo_f429zi := -DSP_CRC_UNIT
CONFIG_board_f405_qemu :=

.DELETE_ON_ERROR:
.PHONY: all programs
all: programs
	@$(CROSS)size $(BOARDS:%=$(BUILD)/%.elf)
programs: $(BOARDS:%=$(BUILD)/%.elf) $(BOARDS:%=$(BUILD)/%.bin)

# What the compiler does not see. board.h prescribes parameters: not every board changes them.
.PHONY: analyse
analyse: $(WIRE)/sweepctl_protocol.c
	@for board in board_f405_qemu:board_f405_qemu board_f429:stm32f429 board_nucleo_f429zi:stm32f429; do \
		$(CPPCHECK) --std=c99 --platform=arm32-wchar_t4 --enable=warning,style,performance,portability \
			--inline-suppr --error-exitcode=1 --quiet --suppress=missingIncludeSystem \
			--suppress=constParameterPointer \
			-USP_CONFIG_FILE $(INCLUDES) -I$${board%:*} -I$${board#*:} $${board#*:}/*.c board_common/*.c || exit 1; \
	done

$(WIRE)/sweepctl_protocol.c: $(wildcard $(HERE)../../protocol/*.py $(HERE)../../protocol/generate/c*.py)
	@cd $(HERE)../.. && $(PYTHON) -m tools.sweepctl generate c --force --out $(abspath $(WIRE)) >/dev/null

$(BUILD)/%.bin: $(BUILD)/%.elf
	@$(CROSS)objcopy -O binary $< $@

# One rule set for each board: its objects are its own, as its settings may be.
define rules_for
SOURCES_$(1) := $$(CORE) $$(wildcard $(1)/*.c $$(addsuffix /*.c,$$(CHIP_$(1))))
OBJECTS_$(1) := $$(SOURCES_$(1):%.c=$$(BUILD)/$(1).o/%.o) $$(BUILD)/$(1).o/wire.o

$$(BUILD)/$(1).o/wire.o: $$(WIRE)/sweepctl_protocol.c
	@mkdir -p $$(@D)
	@$$(CROSS)gcc $$(CFLAGS) $$(CONFIG_$(1)) -I$$(WIRE) -MMD -c $$< -o $$@

$$(BUILD)/$(1).o/%.o: %.c | $$(WIRE)/sweepctl_protocol.c
	@mkdir -p $$(@D)
	@$$(CROSS)gcc $$(CFLAGS) $$(CONFIG_$(1)) -I$(1) $$(addprefix -I,$$(CHIP_$(1))) $$(INCLUDES) -MMD -c $$< -o $$@

$$(BUILD)/$(1).elf: $$(OBJECTS_$(1)) $(1)/memory.ld board_common/sections.ld
	@$$(CROSS)gcc $$(CFLAGS) $$(OBJECTS_$(1)) $$(LDFLAGS) -T $(1)/memory.ld -Wl,-Map=$$(BUILD)/$(1).map -lm -o $$@

-include $$(OBJECTS_$(1):.o=.d)
endef
$(foreach name,$(BOARDS),$(eval $(call rules_for,$(name))))
