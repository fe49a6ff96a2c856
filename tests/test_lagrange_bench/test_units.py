"""Every unit that a file may name has the factor of an independent table, SciPy's constants."""

import numpy as np
import pytest
from scipy import constants

from lagrange_bench.judging.names import UNITS, unit_of
from lagrange_bench.judging.rows import number

TURN = 2 * np.pi
SI = {
    "s": {
        "s sec secs second seconds": 1.0,
        "ms msec msecs millis millisecond milliseconds": constants.milli,
        "us usec usecs micros microsecond microseconds": constants.micro,
        "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds": constants.nano,
        "ps picosecond picoseconds": constants.pico,
        "fs femtosecond femtoseconds": constants.femto,
        "min mins minute minutes": constants.minute,
        "h hr hrs hour hours": constants.hour,
        "d day days": constants.day,
    },
    "m": {
        "m meter meters metre metres": 1.0,
        "cm centimeter centimeters centimetre centimetres": constants.centi,
        "mm millimeter millimeters millimetre millimetres": constants.milli,
        "um micron microns micrometer micrometers": constants.micron,
        "nm nanometer nanometers": constants.nano,
        "å angstrom angstroms": constants.angstrom,
        "km kilometer kilometers": constants.kilo,
        "in inch inches": constants.inch,
        "ft foot feet": constants.foot,
    },
    "rad": {
        "rad rads radian radians": 1.0,
        "mrad": constants.milli,
        "deg degs degree degrees": constants.degree,
        "rev revs revolution revolutions turn turns": TURN,
    },
    "rad/s": {"rpm": TURN / constants.minute, "dps degps": constants.degree, "hz": TURN, "1/s": 1.0},
    "1": {"- 1 none unitless dimensionless": 1.0},
}
KNOWN = [(name, kind, factor) for kind, rows in SI.items() for names, factor in rows.items() for name in names.split()]
QUOTIENTS = [
    ("km/h", "m/s", constants.kmh),
    ("ft/s", "m/s", constants.foot),
    ("deg/s", "rad/s", constants.degree),
    ("deg s^-1", "rad/s", constants.degree),
    ("°/min", "rad/s", constants.degree / constants.minute),
    ("rev per min", "rad/s", TURN / constants.minute),
]


@pytest.mark.parametrize(("name", "kind", "factor"), KNOWN + QUOTIENTS)
def test_a_unit_has_the_factor_of_an_independent_table(name, kind, factor):
    unit = unit_of(name)
    assert unit is not None
    assert (unit.kind, unit.factor) == (kind, pytest.approx(factor, rel=1e-15))


def test_no_unit_is_missing_in_the_table():
    assert set(UNITS) == {name for name, *_ in KNOWN}


def test_a_clock_counts_hours_and_minutes():
    assert number("02:03:04.5") == 2 * constants.hour + 3 * constants.minute + 4.5
