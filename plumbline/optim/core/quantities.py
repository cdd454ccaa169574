"""Numbers in words: units a reader knows, as many digits as the number bears.

A value is shown to two digits of its standard error: 0.24031 mm ± 0.0061 mm is 0.2403 ± 0.0061 mm.
"""

import math

# Factor and name of the unit that is shown for an SI unit.
SHOWN = {
    "m": (1e3, "mm"),
    "rad": (1e3, "mrad"),
    "s": (1e3, "ms"),
    "1": (1e3, "‰"),
    "1/K": (1e6, "ppm/K"),
    "s/K": (1e6, "ppm s/K"),
    "rad/(N m)": (1e6, "µrad/(N m)"),
    "rad kg/(N m)": (1e6, "µrad kg/(N m)"),
    "rad/(N m)^2": (1e9, "nrad/(N m)²"),
    "kg m^2": (1.0, "kg m²"),
    "m/N": (1e6, "µm/N"),
    "m kg/N": (1e6, "µm kg/N"),
    "m/N^2": (1e9, "nm/N²"),
    "1/(N m^2)": (1e6, "×10⁻⁶/(N m²)"),
}
# A hobby servo yields a thousand times as far as an industrial arm: what is shown instead from a
# thousand on.
COARSER = {
    "µrad/(N m)": (1e3, "mrad/(N m)"),
    "µrad kg/(N m)": (1e3, "mrad kg/(N m)"),
    "µm/N": (1e3, "mm/N"),
    "µm kg/N": (1e3, "mm kg/N"),
}


def scaled(unit: str, value: float = 0.0) -> tuple[float, str]:
    """Factor to the unit that a value is shown in, and its name; one not known here stays."""
    factor, name = SHOWN.get(unit, (1.0, unit))
    return COARSER[name] if name in COARSER and abs(value) * factor >= 1e3 else (factor, name)


def quantity(value: float, unit: str) -> str:
    """``0.824 mm``: a value [unit] to three significant digits."""
    factor, name = scaled(unit, value)
    return f"{significant(value * factor)} {name}".rstrip()


def significant(value: float, digits: int = 3) -> str:
    """``0.0870``: so many significant digits, zeros kept; powers of ten where they read better."""
    if not math.isfinite(value):
        return "unknown"
    if value == 0.0:
        return "0"
    power = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if not -4 <= power <= 5:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - power, 0)}f}"


def measured(value: float, std: float, unit: str) -> str:
    """``0.2403 ± 0.0061 mm``: a value and its standard error [unit]."""
    factor, name = scaled(unit, value)
    value, std = value * factor, std * factor
    if not (math.isfinite(value) and math.isfinite(std) and std > 0.0):
        return f"{significant(value)} {name}".rstrip()
    places = 1 - math.floor(math.log10(std))
    if not 0 <= places <= 6 or abs(value) >= 1e6:
        return f"{significant(value)} ± {significant(std, 2)} {name}".rstrip()
    value = round(value, places) + 0.0  # no minus before a zero
    return f"{value:.{places}f} ± {std:.{places}f} {name}".rstrip()


def percent(share: float) -> str:
    """``98 %``; what is not quite certain never reads 0 or 100."""
    if not math.isfinite(share):
        return "unknown"
    if 0.995 <= share < 1.0:
        return "> 99 %"
    if 0.0 < share < 0.005:
        return "< 1 %"
    return f"{100.0 * share:.0f} %"


def chance(probability: float) -> str:
    """``98 %`` of a probability, which the arithmetic may round to 0 or 1 but no data make so."""
    return percent(min(max(probability, 1e-9), 1.0 - 1e-9))


def counted(count: int, noun: str) -> str:
    """``1 cause``, ``3 causes``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
