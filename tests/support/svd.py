"""Register data from a chip's SVD file, for the registers that the firmware uses.

    PYTHONPATH=tests python -m support.svd STM32F429x.svd

This command writes ``tests/vectors/stm32f429.json``. The file has the base address and the
registers of each peripheral, and the number of each interrupt. A register has an offset, and the
first bit and width of each field. ST publishes the SVD file; version 0.4 of the Python package
``cmsis-svd`` contains it.
"""

from __future__ import annotations

import json
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING, Any

from support.root import ROOT

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

FACTS = ROOT / "tests" / "vectors" / "stm32f429.json"
PERIPHERALS = (
    *("ADC1", "C_ADC", "CAN1", "CRC", "DBG", "DMA1", "DMA2", "EXTI", "FLASH", "GPIOA", "GPIOB"),
    *("GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG", "I2C1", "IWDG", "PWR", "RCC", "RNG", "SYSCFG"),
    *("TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "USART1", "USART2", "USART3"),
)


def _text(element: Element, name: str) -> str:
    found = element.find(name)
    if found is None or found.text is None:
        raise ValueError(f"no {name} in {element.tag}")
    return found.text


def _registers(peripheral: Element) -> dict[str, Any]:
    return {
        _text(register, "name"): {
            "offset": int(_text(register, "addressOffset"), 0),
            "fields": {
                _text(field, "name"): [
                    int(_text(field, "bitOffset"), 0),
                    int(_text(field, "bitWidth"), 0),
                ]
                for field in register.iter("field")
            },
        }
        for register in peripheral.iter("register")
    }


def facts(svd: Path) -> dict[str, Any]:
    """Return the peripherals that the firmware uses, and every interrupt."""
    root = ET.parse(svd).getroot()  # noqa: S314 - a file that the caller chose
    found = {_text(p, "name"): p for p in root.iter("peripheral")}
    return {
        "peripherals": {
            name: {
                "base": int(_text(found[name], "baseAddress"), 0),
                "registers": _registers(found[found[name].get("derivedFrom") or name]),
            }
            for name in PERIPHERALS
        },
        "interrupts": {
            _text(i, "name"): int(_text(i, "value"), 0)
            for p in found.values()
            for i in p.findall("interrupt")
        },
    }


if __name__ == "__main__":
    FACTS.write_text(
        json.dumps(facts(Path(sys.argv[1])), separators=(",", ":"), sort_keys=True) + "\n"
    )
