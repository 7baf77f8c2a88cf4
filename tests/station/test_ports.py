"""The station has the ports that its README says, with the sizes that it says."""

import re
from pathlib import Path

import pytest

import uvms_drake as uv

README = Path(__file__).parents[2] / "uvms_drake" / "station" / "README.md"


def written() -> dict[str, str]:
    """Returns the sizes by the names of the ports in the README's tables."""
    out: dict[str, str] = {}
    for line in README.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        names = re.findall(r"`(\w+)`", cells[0])
        if line.startswith("| `"):
            sizes = cells[1].split(", ")
            out |= dict(zip(names, sizes * len(names) if len(sizes) == 1 else sizes, strict=False))
    return out


@pytest.mark.parametrize("name", [
    "girona500_contact", "jacket_inspection", "girona500_real_loop", "girona500_ideal"])
def test_every_port_is_in_the_readme_with_its_size(name):
    scenario = uv.load_scenario(name)
    station, table = uv.make_station(scenario), written()
    size = uv.load_model(scenario).size
    sizes = {"2(6+n)": 2 * size, "6+n": size, "m": 5, "abstract": 0}
    ports = [*(station.get_input_port(i) for i in range(station.num_input_ports())),
             *(station.get_output_port(i) for i in range(station.num_output_ports()))]
    for port in ports:
        text = table[port.get_name()]
        assert port.size() == sizes.get(text, int(text) if text.isdecimal() else None), text


def test_the_readme_has_no_port_that_is_nowhere():
    found: set[str] = set()
    for name, overrides in (("jacket_inspection_real", []), ("girona500_ideal", []),
                            ("girona500_real_loop", ["model_error.payload.mass=0.1"])):
        station = uv.make_station(uv.load_scenario(name, overrides))
        found |= {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
        found |= {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    assert set(written()) == found
