"""The firmware as a library in the CMake project of a user."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.c_build import locked, run
from support.core_build import FIRMWARE

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.slow, pytest.mark.needs("gcc")]

PROJECT = f"""
cmake_minimum_required(VERSION 3.18)
project(somebody LANGUAGES C)
set(SWEEPCTL_DEFINITIONS INBOX_BYTES=256u CACHE STRING "")
add_subdirectory("{FIRMWARE}" firmware)
add_executable(robot main.c "{FIRMWARE}/board_host/script.c")
target_include_directories(robot PRIVATE "{FIRMWARE}/board_host")
target_link_libraries(robot PRIVATE sweepctl::core m)
"""
MAIN = """
#include "firmware_state.h"
#include "script.h"

static void nowhere(void *to, const uint8_t *data, size_t length)
{
    (void)to, (void)data, (void)length;
}

int main(void)
{
    script_begin(1000000);
    script_take((const uint8_t *)"S\\xA0\\x86\\x01\\0\\0\\0", 7, nowhere, NULL);
    return INBOX_BYTES == 256u ? 0 : 1;
}
"""


def test_a_project_adds_the_core_and_its_settings(tmp_path: Path) -> None:
    (tmp_path / "CMakeLists.txt").write_text(PROJECT)
    (tmp_path / "main.c").write_text(MAIN)
    build = tmp_path / "build"
    ninja = f"-DCMAKE_MAKE_PROGRAM={locked('ninja')}"
    run([locked("cmake"), "-S", tmp_path, "-B", build, "-G", "Ninja", ninja])
    run([locked("cmake"), "--build", build])
    run([build / "robot"])
