"""Numbers in the words of a reader: 0.15 mm, 20 mN, 6 %."""


def percent(share: float) -> str:
    """Return a share as a percentage with two digits."""
    return f"{digits(100 * share)} %"


def length(metres: float) -> str:
    """Return a length in mm, or in µm below a tenth of a mm."""
    small = abs(metres) < 0.995e-4
    return f"{digits(1e6 * metres)} µm" if small else f"{digits(1e3 * metres)} mm"


def force(newtons: float) -> str:
    """Return a force in N, or in mN below a tenth of a N."""
    return f"{digits(1e3 * newtons)} mN" if abs(newtons) < 0.0995 else f"{digits(newtons)} N"


def pressure(pascals: float) -> str:
    """Return a modulus in kPa, or in Pa below 1 kPa."""
    return f"{digits(pascals)} Pa" if abs(pascals) < 995 else f"{digits(1e-3 * pascals)} kPa"


def seconds(time: float) -> str:
    """Return a time in s, from two minutes on in min."""
    return f"{digits(time)} s" if time < 120 else f"{digits(time / 60)} min"


def more(amount: float, positive: str, negative: str) -> str:
    """Return the word for the sign of an amount."""
    return positive if amount >= 0 else negative


def digits(value: float) -> str:
    """Return two significant digits, three from 100 on, never an exponent.

    >>> digits(0.0123), digits(12.3), digits(123.4), digits(12345.0)
    ('0.012', '12', '123', '12300')
    """
    digits = 3 if abs(value) >= 99.5 else 2
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text
