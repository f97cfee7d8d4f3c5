"""The register definitions of the boards, compared with publications of ST and ARM.

Addresses and bits of the STM32F4 come from ST's own description of the chip
(``tests/vectors/stm32f429.json``, made by ``support.svd``). Values that are missing there, and
the processor's own registers, come from the manuals RM0090 and PM0214. The compiler evaluates
our definitions.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

from support.c_build import run, tool
from support.root import ROOT
from support.svd import FACTS

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")

HEADERS = ROOT / "sim_device" / "firmware" / "board_common"
CHIP = json.loads(FACTS.read_text())
TEXT = (HEADERS / "stm32f4.h").read_text()

ADDRESSES = {
    "RCC->cr": "RCC.CR", "RCC->pllcfgr": "RCC.PLLCFGR", "RCC->cfgr": "RCC.CFGR",
    "RCC->ahb1rstr": "RCC.AHB1RSTR", "RCC->apb1rstr": "RCC.APB1RSTR",
    "RCC->apb2rstr": "RCC.APB2RSTR",
    "RCC->ahb1enr": "RCC.AHB1ENR", "RCC->ahb2enr": "RCC.AHB2ENR", "RCC->apb1enr": "RCC.APB1ENR",
    "RCC->apb2enr": "RCC.APB2ENR", "RCC->csr": "RCC.CSR", "PWR->cr": "PWR.CR",
    "PWR->csr": "PWR.CSR",
    "FLASH->acr": "FLASH.ACR", "FLASH->keyr": "FLASH.KEYR", "FLASH->sr": "FLASH.SR",
    "FLASH->cr": "FLASH.CR", "FLASH->optcr": "FLASH.OPTCR", "CRC->dr": "CRC.DR",
    "CRC->cr": "CRC.CR", "GPIO(0)->moder": "GPIOA.MODER", "GPIO(1)->otyper": "GPIOB.OTYPER",
    "GPIO(2)->ospeedr": "GPIOC.OSPEEDR", "GPIO(3)->pupdr": "GPIOD.PUPDR",
    "GPIO(4)->bsrr": "GPIOE.BSRR", "GPIO(5)->idr": "GPIOF.IDR", "GPIO(6)->afr[1]": "GPIOG.AFRH",
    "SYSCFG->exticr[1]": "SYSCFG.EXTICR2", "EXTI->imr": "EXTI.IMR", "EXTI->rtsr": "EXTI.RTSR",
    "EXTI->pr": "EXTI.PR", "DMA1->ifcr[0]": "DMA1.LIFCR", "DMA2->ifcr[1]": "DMA2.HIFCR",
    "DMA1->stream[0].cr": "DMA1.S0CR", "DMA1->stream[3].par": "DMA1.S3PAR",
    "DMA2->stream[2].ndtr": "DMA2.S2NDTR", "DMA2->stream[7].m0ar": "DMA2.S7M0AR",
    "ADC1->sr": "ADC1.SR", "ADC1->cr1": "ADC1.CR1", "ADC1->cr2": "ADC1.CR2",
    "ADC1->smpr1": "ADC1.SMPR1", "ADC1->smpr2": "ADC1.SMPR2", "ADC1->sqr[0]": "ADC1.SQR1",
    "ADC1->sqr[2]": "ADC1.SQR3", "ADC1->dr": "ADC1.DR", "ADC_CCR": "C_ADC.CCR",
    "TIM1->ccmr[1]": "TIM1.CCMR2_Output", "TIM1->ccr[3]": "TIM1.CCR4", "TIM1->bdtr": "TIM1.BDTR",
    "TIM1->egr": "TIM1.EGR", "TIM2->cnt": "TIM2.CNT", "TIM2->psc": "TIM2.PSC",
    "TIM2->arr": "TIM2.ARR", "TIM2->cr1": "TIM2.CR1", "TIM3->smcr": "TIM3.SMCR",
    "TIM4->ccmr[0]": "TIM4.CCMR1_Input", "TIM4->ccer": "TIM4.CCER", "TIM5->ccr[1]": "TIM5.CCR2",
    "TIM5->dier": "TIM5.DIER", "TIM5->sr": "TIM5.SR", "IWDG->kr": "IWDG.KR", "IWDG->pr": "IWDG.PR",
    "IWDG->rlr": "IWDG.RLR", "RNG->cr": "RNG.CR", "RNG->sr": "RNG.SR", "RNG->dr": "RNG.DR",
    "I2C1->cr1": "I2C1.CR1", "I2C1->cr2": "I2C1.CR2", "I2C1->dr": "I2C1.DR",
    "I2C1->sr1": "I2C1.SR1", "I2C1->sr2": "I2C1.SR2", "I2C1->ccr": "I2C1.CCR",
    "I2C1->trise": "I2C1.TRISE", "USART1->sr": "USART1.SR", "USART1->dr": "USART1.DR",
    "USART2->brr": "USART2.BRR", "USART3->cr1": "USART3.CR1", "USART3->cr3": "USART3.CR3",
    "CAN1->mcr": "CAN1.MCR", "CAN1->msr": "CAN1.MSR", "CAN1->tsr": "CAN1.TSR",
    "CAN1->rfr[0]": "CAN1.RF0R", "CAN1->ier": "CAN1.IER", "CAN1->esr": "CAN1.ESR",
    "CAN1->btr": "CAN1.BTR", "CAN1->tx[0].ir": "CAN1.TI0R", "CAN1->tx[2].dhr": "CAN1.TDH2R",
    "CAN1->rx[0].dtr": "CAN1.RDT0R", "CAN1->rx[0].dlr": "CAN1.RDL0R", "CAN1->fmr": "CAN1.FMR",
    "CAN1->fm1r": "CAN1.FM1R", "CAN1->fs1r": "CAN1.FS1R", "CAN1->ffa1r": "CAN1.FFA1R",
    "CAN1->fa1r": "CAN1.FA1R", "CAN1->filter[0].fr2": "CAN1.F0R2",
    "DBGMCU_APB1_FZ": "DBG.DBGMCU_APB1_FZ",
}  # fmt: skip
"""The register of the chip for each address expression of our header."""
BITS: dict[str, tuple[str, dict[str, int]]] = {
    "RCC_PLLCFGR_SRC_HSE": ("RCC.PLLCFGR", {"PLLSRC": 1}),
    "RCC_CFGR_SW_MASK": ("RCC.CFGR", {"SW1": 1, "SW0": 1}),
    "RCC_CFGR_SW_PLL": ("RCC.CFGR", {"SW1": 1}),
    "RCC_CFGR_SWS_MASK": ("RCC.CFGR", {"SWS1": 1, "SWS0": 1}),
    "RCC_CFGR_SWS_PLL": ("RCC.CFGR", {"SWS1": 1}),
    "RCC_CFGR_PPRE1_DIV4": ("RCC.CFGR", {"PPRE1": 0b101}),
    "RCC_CFGR_PPRE2_DIV2": ("RCC.CFGR", {"PPRE2": 0b100}),
    "RCC_CSR_PINRSTF": ("RCC.CSR", {"PADRSTF": 1}),
    "RCC_CSR_IWDGRSTF": ("RCC.CSR", {"WDGRSTF": 1}),
    "RCC_AHB1_GPIO(6)": ("RCC.AHB1ENR", {"GPIOGEN": 1}),
    "PWR_CR_VOS_SCALE_1": ("PWR.CR", {"VOS": 3}),
    "FLASH_ACR_LATENCY_5": ("FLASH.ACR", {"LATENCY": 5}),
    "FLASH_SR_ERRORS": (
        "FLASH.SR",
        {"OPERR": 1, "WRPERR": 1, "PGAERR": 1, "PGPERR": 1, "PGSERR": 1},
    ),
    "FLASH_CR_SNB(16)": ("FLASH.CR", {"SNB": 16}),
    "FLASH_CR_PSIZE_32": ("FLASH.CR", {"PSIZE": 2}),
    "CRC_CR_RESET": ("CRC.CR", {"CR": 1}),
    "DMA_CR_DIR_TO_PERIPHERAL": ("DMA1.S0CR", {"DIR": 1}),
    "DMA_CR_PSIZE_16": ("DMA1.S0CR", {"PSIZE": 1}),
    "DMA_CR_MSIZE_16": ("DMA1.S0CR", {"MSIZE": 1}),
    "DMA_CR_PL_HIGH": ("DMA1.S0CR", {"PL": 2}),
    "DMA_CR_CHSEL(4)": ("DMA1.S0CR", {"CHSEL": 4}),
    "DMA_FLAG_TE": ("DMA1.LISR", {"TEIF0": 1}),
    "DMA_FLAG_HT": ("DMA1.LISR", {"HTIF0": 1}),
    "DMA_FLAG_TC": ("DMA1.LISR", {"TCIF0": 1}),
    "DMA_FLAGS_ALL": (
        "DMA1.LIFCR",
        {"CFEIF0": 1, "CDMEIF0": 1, "CTEIF0": 1, "CHTIF0": 1, "CTCIF0": 1},
    ),
    "(DMA_FLAG_TC << DMA_FLAGS_AT(1))": ("DMA1.LIFCR", {"CTCIF1": 1}),
    "(DMA_FLAG_TC << DMA_FLAGS_AT(2))": ("DMA1.LIFCR", {"CTCIF2": 1}),
    "(DMA_FLAG_TC << DMA_FLAGS_AT(3))": ("DMA1.LIFCR", {"CTCIF3": 1}),
    "(DMA_FLAG_TC << DMA_FLAGS_AT(7))": ("DMA1.HIFCR", {"CTCIF7": 1}),
    "ADC_CCR_PRESCALE_4": ("C_ADC.CCR", {"ADCPRE": 1}),
    "TIM_CR1_CKD_4": ("TIM2.CR1", {"CKD": 2}),
    "TIM_DIER_CCIE(2)": ("TIM5.DIER", {"CC2IE": 1}),
    "TIM_SR_CCIF(2)": ("TIM5.SR", {"CC2IF": 1}),
    "TIM_CCER_CCE(4)": ("TIM1.CCER", {"CC4E": 1}),
    "TIM_CCER_CCP(2)": ("TIM5.CCER", {"CC2P": 1}),
    "TIM_SMCR_ENCODER_BOTH": ("TIM3.SMCR", {"SMS": 3}),
    "IWDG_KEY_START": ("IWDG.KR", {"KEY": 0xCCCC}),
    "IWDG_KEY_WRITE": ("IWDG.KR", {"KEY": 0x5555}),
    "IWDG_KEY_FEED": ("IWDG.KR", {"KEY": 0xAAAA}),
    "RNG_CR_EN": ("RNG.CR", {"RNGEN": 1}),
    "RNG_SR_FAULTS": ("RNG.SR", {"CECS": 1, "SECS": 1}),
    "I2C_SR1_TXE": ("I2C1.SR1", {"TxE": 1}),
    "I2C_SR1_ERRORS": (
        "I2C1.SR1",
        {"BERR": 1, "ARLO": 1, "AF": 1, "OVR": 1, "PECERR": 1, "TIMEOUT": 1, "SMBALERT": 1},
    ),
    "I2C_CCR_FAST": ("I2C1.CCR", {"F_S": 1}),
    "USART_SR_ERRORS": ("USART1.SR", {"PE": 1, "FE": 1, "NF": 1, "ORE": 1}),
    "CAN_TSR_TME(2)": ("CAN1.TSR", {"TME2": 1}),
    "CAN_TSR_RQCP(1)": ("CAN1.TSR", {"RQCP1": 1}),
    "CAN_TSR_ABRQ(2)": ("CAN1.TSR", {"ABRQ2": 1}),
    "CAN_RFR_FMP_MASK": ("CAN1.RF0R", {"FMP0": 3}),
    "CAN_RFR_FOVR": ("CAN1.RF0R", {"FOVR0": 1}),
    "CAN_RFR_RFOM": ("CAN1.RF0R", {"RFOM0": 1}),
    "(CAN_ESR_TEC(0xFFFFFFFFu) << 16)": ("CAN1.ESR", {"TEC": 0xFF}),
    "(CAN_ESR_REC(0xFFFFFFFFu) << 24)": ("CAN1.ESR", {"REC": 0xFF}),
    "CAN_IR_TXRQ": ("CAN1.TI0R", {"TXRQ": 1}),
    "CAN_IR_RTR": ("CAN1.TI0R", {"RTR": 1}),
    "CAN_IR_IDE": ("CAN1.TI0R", {"IDE": 1}),
    "(1u << CAN_IR_STID_SHIFT)": ("CAN1.TI0R", {"STID": 1}),
    "DBGMCU_APB1_FZ_IWDG": ("DBG.DBGMCU_APB1_FZ", {"DBG_IWDEG_STOP": 1}),
}
"""Definitions that have more than one bit, or no name like PERIPHERAL_REGISTER_FIELD."""
RESETS = {
    "RCC_AHB1_DMA1": ("RCC.AHB1RSTR", {"DMA1RST": 1}),
    "RCC_AHB1_DMA2": ("RCC.AHB1RSTR", {"DMA2RST": 1}),
    "RCC_APB1_TIM2": ("RCC.APB1RSTR", {"TIM2RST": 1}),
    "RCC_APB1_TIM3": ("RCC.APB1RSTR", {"TIM3RST": 1}),
    "RCC_APB1_TIM4": ("RCC.APB1RSTR", {"TIM4RST": 1}),
    "RCC_APB1_TIM5": ("RCC.APB1RSTR", {"TIM5RST": 1}),
    "RCC_APB1_USART3": ("RCC.APB1RSTR", {"UART3RST": 1}),
    "RCC_APB1_I2C1": ("RCC.APB1RSTR", {"I2C1RST": 1}),
    "RCC_APB1_CAN1": ("RCC.APB1RSTR", {"CAN1RST": 1}),
    "RCC_APB2_TIM1": ("RCC.APB2RSTR", {"TIM1RST": 1}),
    "RCC_APB2_USART1": ("RCC.APB2RSTR", {"USART1RST": 1}),
    "RCC_APB2_ADC1": ("RCC.APB2RSTR", {"ADCRST": 1}),
}
"""Bits that the firmware uses for the clock and for the reset of a peripheral."""
BY_THE_MANUAL = {
    "FLASH_KEY_1": 0x4567_0123,  # 3.6.1
    "FLASH_KEY_2": 0xCDEF_89AB,
    "FLASH_OPTCR_DB1M": 1 << 30,  # 3.9.10; not in ST's description
    "ADC_SAMPLE_144": 6,  # 13.13.4
    "CAN_MAILBOXES": 3,  # 32.4
    "(uintptr_t)DEVICE_UID": 0x1FFF_7A10,  # 39.1
    "(uintptr_t)&FLASH_KIB": 0x1FFF_7A22,  # 39.2
}
CORTEX_M4 = {
    # PM0214, tables 45 (NVIC), 50 (SCB), 54 (SysTick), 56 (FPU)
    "NVIC->iser[2]": 0xE000_E108,
    "NVIC->icer[2]": 0xE000_E188,
    "NVIC->icpr[2]": 0xE000_E288,
    "NVIC->ip[58]": 0xE000_E43A,
    "SCB->icsr": 0xE000_ED04,
    "SCB->vtor": 0xE000_ED08,
    "SCB->aircr": 0xE000_ED0C,
    "SCB->shpr[11]": 0xE000_ED23,
    "SYSTICK->ctrl": 0xE000_E010,
    "SYSTICK->load": 0xE000_E014,
    "SCB_CPACR": 0xE000_ED88,
}
_PERIPHERALS = {"DMA": "DMA1", "ADC": "ADC1", "TIM": "TIM1", "I2C": "I2C1", "USART": "USART1"}
_PERIPHERALS |= {"CAN": "CAN1"}
_REGISTERS = {"DMA1.CR": "S0CR", "RCC.AHB1": "AHB1ENR", "RCC.AHB2": "AHB2ENR"}
_REGISTERS |= {"RCC.APB1": "APB1ENR", "RCC.APB2": "APB2ENR"}


def address(name: str) -> int:
    peripheral, register = name.split(".")
    found = CHIP["peripherals"][peripheral]
    return int(found["base"] + found["registers"][register]["offset"])


def value(name: str, fields: dict[str, int]) -> int:
    peripheral, register = name.split(".")
    known = CHIP["peripherals"][peripheral]["registers"][register]["fields"]
    total = 0
    for field, content in fields.items():
        bit, width = known[field]
        assert content < 1 << width
        total |= content << bit
    return total


def single_bit(macro: str) -> int | None:
    """Return the bit of a macro named PERIPHERAL_REGISTER_FIELD; None if there is no such field."""
    peripheral, register, field = macro.split("_", 2)
    peripheral = _PERIPHERALS.get(peripheral, peripheral)
    register = _REGISTERS.get(f"{peripheral}.{register}", register)
    registers = CHIP["peripherals"].get(peripheral, {"registers": {}})["registers"]
    fields = registers.get(register, {"fields": {}})["fields"]
    name = field if field in fields else f"{field}EN"
    return value(f"{peripheral}.{register}", {name: 1}) if name in fields else None


def static_assertions(folder: Path, header: str, lines: list[str]) -> None:
    source = folder / "assertions.c"
    source.write_text(f'#include "{header}"\n' + "\n".join(lines) + "\n")
    flags = ("-std=gnu11", "-mcpu=cortex-m4", "-mthumb", "-Wno-pedantic", "-fsyntax-only")
    run([tool("arm-none-eabi-gcc"), *flags, f"-I{HEADERS}", source])


def equal(expression: str, expected: int) -> str:
    return f'_Static_assert({expression} == {expected:#x}u, "{expression}");'


def test_addresses_of_the_chip(tmp_path: Path) -> None:
    lines = [equal(f"(uintptr_t)&{name}", address(where)) for name, where in ADDRESSES.items()]
    static_assertions(tmp_path, "stm32f4.h", lines)


def test_addresses_of_the_processor(tmp_path: Path) -> None:
    lines = [equal(f"(uintptr_t)&{name}", where) for name, where in CORTEX_M4.items()]
    static_assertions(tmp_path, "cortex_m4.h", lines)


def test_every_bit_that_is_defined(tmp_path: Path) -> None:
    """The test covers every definition of the header."""
    lines = [equal(name, value(*where)) for name, where in BITS.items()]
    lines += [equal(name, number) for name, number in BY_THE_MANUAL.items()]
    named = set(re.findall(r"[A-Z]\w+", " ".join((*BITS, *BY_THE_MANUAL, *ADDRESSES))))
    for macro in re.findall(r"^#define (\w+)\b(?!$)", TEXT, re.MULTILINE):
        if macro in named or macro in CHIP["peripherals"]:
            continue
        bit = single_bit(macro)
        assert bit is not None, f"{macro}: no reference value"
        lines.append(equal(macro, bit))
    assert len(lines) > 120
    static_assertions(tmp_path, "stm32f4.h", lines)


def test_a_clock_and_a_reset_have_the_same_bit(tmp_path: Path) -> None:
    static_assertions(
        tmp_path, "stm32f4.h", [equal(name, value(*where)) for name, where in RESETS.items()]
    )


def test_interrupt_numbers(tmp_path: Path) -> None:
    numbers = {f"IRQ_{name.upper()}": number for name, number in CHIP["interrupts"].items()}
    numbers["IRQ_COUNT"] = max(CHIP["interrupts"].values()) + 1
    used = re.findall(r"^    (IRQ_\w+) =", TEXT, re.MULTILINE)
    assert len(used) > 15
    static_assertions(tmp_path, "stm32f4.h", [equal(name, numbers[name]) for name in used])


@pytest.mark.parametrize(
    "wrong", ["(uintptr_t)&TIM2->cnt == 0x40000028u", "CAN_IER_BOFIE == 1u << 11"]
)
def test_a_wrong_definition_is_found(wrong: str, tmp_path: Path) -> None:
    with pytest.raises(pytest.fail.Exception, match="static assertion failed"):
        static_assertions(tmp_path, "stm32f4.h", [f'_Static_assert({wrong}, "");'])
