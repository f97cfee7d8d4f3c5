"""The register addresses that the boards use, against the reference manual's register maps.

Address of a register by RM0090 (STM32F405/407/42x/43x): its peripheral's base (section 2.3,
table 1) and the offset in the peripheral's register map. The compiler is asked for the address
that our definitions give.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.c_build import run, tool
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")

HEADERS = ROOT / "sim_device" / "firmware" / "board_common"
STM32F4 = {
    # 3.9.12 FLASH, 4.4.4 CRC, 5.6.2 PWR, 6.3.29 RCC
    "FLASH->keyr": 0x4002_3C04,
    "FLASH->sr": 0x4002_3C0C,
    "FLASH->cr": 0x4002_3C10,
    "FLASH->optcr": 0x4002_3C14,
    "CRC->cr": 0x4002_3008,
    "PWR->cr": 0x4000_7000,
    "RCC->pllcfgr": 0x4002_3804,
    "RCC->cfgr": 0x4002_3808,
    "RCC->ahb1enr": 0x4002_3830,
    "RCC->ahb2enr": 0x4002_3834,
    "RCC->apb1enr": 0x4002_3840,
    "RCC->apb2enr": 0x4002_3844,
    "RCC->csr": 0x4002_3874,
    # 8.4.11 GPIO, 9.3.8 SYSCFG, 10.5.11 DMA, 12.3.7 EXTI
    "GPIO(0)->moder": 0x4002_0000,
    "GPIO(1)->idr": 0x4002_0410,
    "GPIO(4)->bsrr": 0x4002_1018,
    "GPIO(6)->afr[1]": 0x4002_1824,
    "SYSCFG->exticr[1]": 0x4001_380C,
    "DMA1->ifcr[0]": 0x4002_6008,
    "DMA1->stream[0].cr": 0x4002_6010,
    "DMA2->ifcr[1]": 0x4002_640C,
    "DMA2->stream[2].ndtr": 0x4002_6444,
    "DMA2->stream[7].m0ar": 0x4002_64C4,
    "EXTI->imr": 0x4001_3C00,
    "EXTI->pr": 0x4001_3C14,
    # 13.13.18 ADC
    "ADC1->cr2": 0x4001_2008,
    "ADC1->smpr1": 0x4001_200C,
    "ADC1->sqr[0]": 0x4001_202C,
    "ADC1->dr": 0x4001_204C,
    "ADC_CCR": 0x4001_2304,
    # 17.4.21, 18.4.21 timers
    "TIM1->bdtr": 0x4001_0044,
    "TIM1->ccr[3]": 0x4001_0040,
    "TIM2->cnt": 0x4000_0024,
    "TIM2->psc": 0x4000_0028,
    "TIM2->arr": 0x4000_002C,
    "TIM3->smcr": 0x4000_0408,
    "TIM4->ccmr[0]": 0x4000_0818,
    "TIM5->ccer": 0x4000_0C20,
    "TIM5->ccr[1]": 0x4000_0C38,
    # 21.4.5 IWDG, 24.4.4 RNG, 27.6.11 I2C, 30.6.8 USART
    "IWDG->rlr": 0x4000_3008,
    "RNG->dr": 0x5006_0808,
    "I2C1->dr": 0x4000_5410,
    "I2C1->sr2": 0x4000_5418,
    "I2C1->trise": 0x4000_5420,
    "USART1->dr": 0x4001_1004,
    "USART1->cr1": 0x4001_100C,
    "USART2->cr3": 0x4000_4414,
    # 32.9.5 bxCAN
    "CAN1->tsr": 0x4000_6408,
    "CAN1->rfr[0]": 0x4000_640C,
    "CAN1->ier": 0x4000_6414,
    "CAN1->btr": 0x4000_641C,
    "CAN1->tx[0].ir": 0x4000_6580,
    "CAN1->tx[2].dhr": 0x4000_65AC,
    "CAN1->rx[0].dlr": 0x4000_65B8,
    "CAN1->fmr": 0x4000_6600,
    "CAN1->fs1r": 0x4000_660C,
    "CAN1->ffa1r": 0x4000_6614,
    "CAN1->fa1r": 0x4000_661C,
    "CAN1->filter[0].fr2": 0x4000_6644,
    "DEVICE_UID[2]": 0x1FFF_7A18,
}
CORTEX_M4 = {
    # PM0214, tables 45 (NVIC), 50 (SCB), 54 (SysTick), 56 (FPU)
    "NVIC->iser[2]": 0xE000_E108,
    "NVIC->ip[58]": 0xE000_E43A,
    "SCB->vtor": 0xE000_ED08,
    "SCB->aircr": 0xE000_ED0C,
    "SCB->shpr[11]": 0xE000_ED23,
    "SYSTICK->load": 0xE000_E014,
    "SCB_CPACR": 0xE000_ED88,
}


@pytest.mark.parametrize(
    ("header", "registers"), [("stm32f4.h", STM32F4), ("cortex_m4.h", CORTEX_M4)]
)
def test_addresses(header: str, registers: dict[str, int], tmp_path: Path) -> None:
    source = tmp_path / "addresses.c"
    checks = "".join(
        f'_Static_assert((uintptr_t)&{name} == {address:#x}u, "{name}");\n'
        for name, address in registers.items()
    )
    source.write_text(f'#include "{header}"\n{checks}')
    flags = ("-std=gnu11", "-mcpu=cortex-m4", "-mthumb", "-Wno-pedantic", "-fsyntax-only")
    run([tool("arm-none-eabi-gcc"), *flags, f"-I{HEADERS}", source])


def test_a_wrong_address_is_found(tmp_path: Path) -> None:
    source = tmp_path / "wrong.c"
    source.write_text(
        '#include "stm32f4.h"\n_Static_assert((uintptr_t)&TIM2->cnt == 0x40000028u, "");\n'
    )
    with pytest.raises(pytest.fail.Exception, match="static assertion failed"):
        run([tool("arm-none-eabi-gcc"), "-std=gnu11", "-fsyntax-only", f"-I{HEADERS}", source])
