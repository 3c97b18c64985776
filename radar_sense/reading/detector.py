"""The detector of a radar in a scenario file: a name, or a mapping with its keys."""

from __future__ import annotations

from radar_sense import keys
from radar_sense.errors import InputError
from radar_sense.model.detectors import DETECTORS, Detector, PulseDetector
from radar_sense.reading.yaml_reader import Entry


def read_detector(entry: Entry, p_fa: float) -> Detector:
    """Read a detector.

    Args:
        entry: The name of the detector, or a mapping with the name as its `model`.
        p_fa: Probability of false alarm. A CFAR with few cells cannot have a small P_fa.

    Raises:
        InputError: If anything in the entry is not allowed.
    """
    if not entry.is_mapping():
        cls = DETECTORS[entry.value(keys.DETECTOR)]
        required = [key.name for key in keys.declared(cls) if key.required]
        if required:
            raise entry.error(f"needs a mapping with 'model' and {', '.join(required)}")
        return cls()
    model = keys.DETECTOR_MODEL
    present = entry.entries()
    if model.name not in present:
        raise entry.error(f"missing key 'model', one of {', '.join(DETECTORS)}")
    name = present[model.name].value(model)
    for key, value in present.items():
        owners = [other for other, cls in DETECTORS.items() if key in _keys(cls)]
        if owners and name not in owners:
            raise value.error(
                f"is no key of the detector {name}; detectors with it: {', '.join(owners)}"
            )
    detector = entry.instance(DETECTORS[name], besides=[model.name])
    if isinstance(detector, PulseDetector):
        try:
            detector.tails(p_fa)
        except InputError as error:
            raise entry.error(str(error)) from error
    return detector


def _keys(cls: type[Detector]) -> set[str]:
    return {key.name for key in (*keys.declared(cls), *keys.section_keys(cls))}
