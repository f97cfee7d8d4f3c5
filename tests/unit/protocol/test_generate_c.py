"""The generated C code: its text, compilation with each compiler, and its size on the chip."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, NamedTuple

import pytest

from protocol.generate.c import HEADER, SOURCE, render
from protocol.messages import ALL_MESSAGES
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.fields import I16, U16, number
from protocol.schema.message import Direction, Message, RateClass, message
from support.c_build import COMPILERS, CORTEX_M4, UNIT, ZIG, compiler, generate, run, tool
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.c_build import Generated

pytestmark = pytest.mark.slow

CROSS = "arm-none-eabi-gcc"
MINIMAL_TEXT_BYTES = 3_300
"""Maximum size of the minimal code, bytes. The hash chains of the enumerations take 250 B of it,
and the code that answers requests for them 200 B."""
STACK_BYTES = 200
"""Maximum stack of the deepest call chain, without the caller's own stack, bytes."""
PARSER_RAM_BYTES = 280
BUILDS = {
    "minimal": ("-DSP_MINIMAL",),
    "minimal with CAN": ("-DSP_MINIMAL", "-DSP_WITH_CAN=1"),
    "all without CAN": ("-DSP_WITH_CAN=0",),
    "all": (),
    "all, CRC unit": ("-DSP_CRC_UNIT",),
    "all, full CRC table": ("-DSP_CRC_FULL_TABLE",),
}


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Generated:
    return generate(tmp_path_factory.mktemp("c"))


# ---- text -------------------------------------------------------------------------------------


def test_it_needs_nothing_but_the_compiler_s_own_headers() -> None:
    text = "".join(render().values())
    included = set(re.findall(r"#include (\S+)", text))
    assert included == {"<stdbool.h>", "<stddef.h>", "<stdint.h>", f'"{HEADER}"', "SP_CONFIG_FILE"}


def test_it_is_the_same_each_time_and_plain_ascii_of_bounded_width() -> None:
    files = render()
    assert list(files) == [HEADER, SOURCE]
    assert files == render()
    for text in files.values():
        assert text.isascii()
        assert max(map(len, text.splitlines())) <= 110
        assert "\t" not in text


def test_every_field_is_explained_with_unit_and_range() -> None:
    header = render()[HEADER]
    assert "/* forward; 1 step = 0.000598550415 m/s2 */\n    int16_t accel_x;" in header
    assert "/* chip temperature; 1 step = 0.00294117647 degC; 0 = 36.53 degC */" in header
    assert "0..4000; 65535: none */\n    uint16_t ultrasonic;" in header
    assert "/* what moves the wheels; SP_MODE_*; 0..3 */" in header


def test_a_word_of_the_language_is_no_field_s_name() -> None:
    assert "uint32_t default_;" in render()[HEADER]


def test_it_names_the_catalogue_it_was_made_from() -> None:
    assert f"catalogue 0x{CATALOGUE.hash:08X}" in render()[HEADER]
    assert f"#define SP_CATALOGUE_HASH 0x{CATALOGUE.hash:08X}u" in render()[HEADER]


def test_another_catalogue_gives_another_header(tmp_path: Path) -> None:
    @message(0x60, Direction.DEVICE, RateClass.STREAM, default_hz=3)
    class Fan(Message):
        """A fan; ends no comment: */ really."""

        speed: Annotated[int, number(U16, "count", "its turns */")]
        restrict: Annotated[int, number(I16, "m", "×", scale="0.001", low=-5, can_part=0)]

    made = generate(tmp_path, Catalogue([*ALL_MESSAGES, Fan]))
    assert "#define SP_TYPE_FAN 0x60u" in (tmp_path / HEADER).read_text()
    made.compile("fan.o", [made.source], flags=("-c",))


# ---- compilers --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", COMPILERS)
@pytest.mark.parametrize("build", [*BUILDS, "no floats", "unit's model"])
def test_it_compiles_without_a_warning(generated: Generated, name: str, build: str) -> None:
    more = {"no floats": ("-DSP_NO_FLOAT",), "unit's model": UNIT}
    flags = ("-c", "-O2", *{**BUILDS, **more}[build])
    generated.compile("any.o", [generated.source], compiler=compiler(name), flags=flags)


def test_each_message_can_be_left_out_alone(generated: Generated) -> None:
    for spec in CATALOGUE:
        if not spec.bootstrap:
            flags = ("-c", f"-DSP_WITH_{spec.name.upper()}=0")
            generated.compile("any.o", [generated.source], flags=flags)


@pytest.mark.parametrize("name", [pytest.param("g++", marks=pytest.mark.needs("g++")), "zig"])
def test_a_cpp_compiler_takes_the_header(generated: Generated, name: str) -> None:
    user = generated.directory / "user.cpp"
    user.write_text(f'#include "{HEADER}"\nint main() {{ return sp_direction(0); }}\n')
    command = [*ZIG.command[:-1], "c++"] if name == "zig" else [tool(name)]
    out = generated.directory / "user.o"  # with /dev/null, zig would write to the current folder
    run([*command, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-c", user, "-o", out])


# ---- on the chip ------------------------------------------------------------------------------


class Size(NamedTuple):
    """Sizes of an object for a Cortex-M4 at -Os, bytes."""

    text: int
    """Code and constant tables."""
    ram: int
    """Initialised and zeroed data of the object."""


def on_chip(generated: Generated, flags: tuple[str, ...], name: str = "chip.o") -> Path:
    flags = ("-c", *CORTEX_M4, *flags)
    return generated.compile(name, [generated.source], compiler=compiler(CROSS), flags=flags)


def size_of(path: Path) -> Size:
    text, data, bss = run([tool("arm-none-eabi-size"), path]).decode().splitlines()[1].split()[:3]
    return Size(int(text), int(data) + int(bss))


def struct_sizes(generated: Generated) -> dict[str, int]:
    """Return the sizes of the caller's structs, read from the object without running it."""
    names = ["parser", "sender", "can_sender", "can_message", "can_receiver"]
    probe = generated.directory / "probe.c"
    lines = [f"extern char {n}[sizeof(sp_{n}_t)]; char {n}[sizeof(sp_{n}_t)];" for n in names]
    probe.write_text(f'#include "{HEADER}"\n' + "\n".join(lines) + "\n")
    flags = ("-c", *CORTEX_M4)
    made = generated.compile("probe.o", [probe], compiler=compiler(CROSS), flags=flags)
    listing = run([tool("arm-none-eabi-nm"), "-S", made]).decode()
    return {line.split()[3]: int(line.split()[1], 16) for line in listing.splitlines()}


@pytest.mark.needs(CROSS)
def test_the_minimal_set_is_small(generated: Generated, capsys: pytest.CaptureFixture[str]) -> None:
    sizes = {name: size_of(on_chip(generated, flags)) for name, flags in BUILDS.items()}
    device = generated.compile(
        "device.o",
        [ROOT / "examples" / "device_main.c"],
        compiler=compiler(CROSS),
        flags=("-c", *CORTEX_M4, "-DSP_MINIMAL", f"-I{ROOT / 'examples'}"),
    )
    sizes["(the example's own code)"] = size_of(device)
    structs = struct_sizes(generated)
    with capsys.disabled():
        print("\nCortex-M4, arm-none-eabi-gcc -Os, bytes        text   ram")  # noqa: T201 - the report
        for name, size in sizes.items():
            print(f"  {name:<40} {size.text:>8} {size.ram:>5}")  # noqa: T201 - the report
        for name, ram in structs.items():
            print(f"  {'each sp_' + name + '_t':<40} {'':>8} {ram:>5}")  # noqa: T201 - the report
    assert sizes["minimal"].text < MINIMAL_TEXT_BYTES
    assert all(size.ram == 0 for name, size in sizes.items() if name in BUILDS)
    assert structs["parser"] <= PARSER_RAM_BYTES


@pytest.mark.needs(CROSS)
def test_it_calls_nothing_from_outside(generated: Generated) -> None:
    for flags in BUILDS.values():
        path = on_chip(generated, ("-ffunction-sections", *flags))
        assert run([tool("arm-none-eabi-nm"), "-u", path]) == b""


@pytest.mark.needs(CROSS)
def test_the_stack_is_bounded_and_nothing_recurs(
    generated: Generated, capsys: pytest.CaptureFixture[str]
) -> None:
    on_chip(generated, ("-fcallgraph-info=su",), "stack.o")
    (graph,) = generated.directory.glob("stack*.ci")
    text = graph.read_text()
    nodes = re.findall(r'title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \((\w+)\)', text)
    own = {name: int(size) for name, size, _ in nodes}
    calls: dict[str, set[str]] = {name: set() for name in own}
    for caller, called in re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', text):
        assert called in own, called  # neither a function pointer nor a library function
        calls[caller].add(called)
    assert {kind for _, _, kind in nodes} == {"static"}  # no array of variable length

    def deepest(name: str, above: tuple[str, ...] = ()) -> int:
        assert name not in above, f"{name} calls itself"
        return own[name] + max((deepest(c, (*above, name)) for c in calls[name]), default=0)

    depths = sorted(((deepest(name), name) for name in own), reverse=True)
    with capsys.disabled():
        reported = ", ".join(f"{name.split(':')[-1]} {depth}" for depth, name in depths[:4])
        print(f"\ndeepest stacks in bytes, calls included: {reported}")  # noqa: T201 - the report
    assert len(own) > 60
    assert depths[0][0] <= STACK_BYTES
