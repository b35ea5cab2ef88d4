"""One effect that does as well as two is no name: the pairs stand beside it."""

from dataclasses import replace

import numpy as np

from fem import Contacts
from identify.catalogue.catalogue import CATALOGUE
from identify.fit.contact_law import contact_law
from identify.measurement.chain import OperatingPoint
from identify.measurement.noise import Noise
from tests.identify.fit.test_contact_law import BALL, NU, PRESSES, flat

EFFECTS = [CATALOGUE[name] for name in ("hysteresis", "play", "contact_offset", "force_bias")]
UP = np.linspace(0.1, 1.0, 9)
LEVELS = np.concatenate([UP, [1.0, 1.0], UP[::-1]])


def looped(law: dict, seed: int):
    """Noisy presses of a ball to and fro on a soft body under a law, each with its own modulus."""
    rng = np.random.default_rng(seed)
    own, radius, noise = flat(0), 0.6 * BALL, Noise(2e-5, 5e-3)
    place = Contacts(own.contacts.points_m, own.contacts.directions, radius, "hertz")
    unit = np.full(PRESSES, 0.6 * (1 - NU**2) / (1.15 * radius))
    modulus = 8e3 * np.exp(rng.normal(0, 0.2, PRESSES))
    press, force = np.repeat(np.arange(PRESSES), len(LEVELS)), np.tile(0.15 * LEVELS, PRESSES)
    phase = np.tile(np.repeat(["load", "hold", "unload"], (9, 2, 9)), PRESSES)
    first = own.readings.point_m[own.readings.first]
    readings = replace(
        own.readings, press=press, point_m=first[press], phase=phase, force_n=force,
        direction=np.tile([0.0, 0.0, -1.0], (len(force), 1)), radius_m=np.full(len(force), BALL),
    )  # fmt: skip
    own = replace(own, readings=readings, noise=noise, contacts=place, unit_compliance=unit)
    chain = own.chain([CATALOGUE[name] for name in law])
    travel = chain.predict(OperatingPoint(unit / modulus, modulus, force, law))
    return replace(
        own,
        displacement_m=travel + noise.displacement_m * rng.standard_normal(len(force)),
        readings=replace(readings, force_n=force + noise.force_n * rng.standard_normal(len(force))),
    )


def test_a_play_that_does_as_well_as_a_loop_and_a_late_touch_has_the_pair_beside_it():
    law = {"hysteresis": {"h": 0.12}, "contact_offset": {"offset_m": -1.8e-4}}
    found = contact_law(looped(law, 1), EFFECTS)
    assert found.names == ("play",)
    pairs = found.splits("play")
    assert next(names for names, _ in pairs) == ("hysteresis", "contact_offset")
    # The same pair is none where it takes more numbers than the effect
    longer = {names: replace(fit, parts=3 * fit.parts) for names, fit in pairs}
    assert replace(found, fits={**found.fits, **longer}).splits("play") == []
    values = pairs[0][1].values
    assert abs(values["hysteresis"]["h"] - 0.12) < 0.02
    assert abs(values["contact_offset"]["offset_m"] + 1.8e-4) < 5e-5


def test_a_loop_alone_has_no_pair_beside_it():
    found = contact_law(looped({"hysteresis": {"h": 0.12}}, 2), EFFECTS)
    assert found.names == ("hysteresis",)
    assert found.splits("hysteresis") == []
