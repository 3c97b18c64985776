"""The data sheet of a radar: the parameters of its radar constant, and their tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any

from radar_sense import keys
from radar_sense.limits import LARGEST, NOT_NEGATIVE, SMALLEST
from radar_sense.model.radar_constant import (
    MAX_DIVISOR_STD,
    TOLERANCE_DB,
    DataSheet,
    Tolerance,
    column_name,
    loss_key,
    nest_losses,
)
from radar_sense.model.radar_equation import LOSSES, RADARS, SEARCH_FACTORS
from radar_sense.reading.yaml_reader import Entry


def read_data_sheet(entry: Entry, kind: str) -> DataSheet:
    """Read the parameters of a radar, each in one of its units.

    Args:
        entry: The mapping.
        kind: A name in `radar_equation.RADARS`.

    Raises:
        InputError: If anything in the mapping is not allowed.
    """
    cls = RADARS[kind]
    declared = [f for f in fields(cls) if "units" in f.metadata]
    parameters = list(zip(declared, keys.declared_units(cls), strict=True))
    others = [keys.LOSSES_DB, *([keys.SEARCH_FACTOR] if kind == "surveillance" else [])]
    names = [key.name for _, units in parameters for key in units]
    entries = entry.mapping([], [*names, *(key.name for key in others)])
    values: dict[str, float] = {}
    arguments: dict[str, Any] = {}
    losses = _read_losses(entries, names)
    for field, units in parameters:
        present = [key for key in units if key.name in entries]
        if not present and field.default is not MISSING:
            continue
        if not present and losses and field.name == "loss_db":  # all losses have names
            arguments[field.name] = 0.0
            continue
        if not present and "assumed" in field.metadata:
            values[units[0].name] = arguments[field.name] = field.metadata["assumed"]
            continue
        if len(present) != 1:
            alternatives = " and ".join(f"'{key.name}'" for key in units)
            if len(units) == 1:
                raise entry.error(f"missing key {alternatives}")
            raise entry.error(f"needs exactly one of the keys {alternatives}")
        (key,) = present
        values[key.name] = entries[key.name].value(key)
        arguments[field.name] = field.metadata["units"][key.name].to_si(values[key.name])
    values |= {loss_key(name): loss for name, loss in losses.items()}
    arguments[keys.LOSSES_DB.name] = losses
    search_factor: int | str | None = None
    if keys.SEARCH_FACTOR in others:
        name = (
            entries["search_factor"].value(keys.SEARCH_FACTOR)
            if "search_factor" in entries
            else keys.SEARCH_FACTOR.default
        )
        arguments["search_factor"] = SEARCH_FACTORS[name]
        search_factor = int(name) if name.isdigit() else name
    constant = cls(**arguments).constant()
    if not SMALLEST <= constant <= LARGEST:
        raise entry.error(
            f"makes the radar constant {constant:g} J m^2/K, allowed is {SMALLEST:g} to {LARGEST:g}"
        )
    return DataSheet(kind, constant, values, search_factor)


def _read_losses(entries: Mapping[str, Entry], names: Sequence[str]) -> dict[str, float]:
    """Read the losses by name [dB].

    Args:
        entries: The mapping of the radar.
        names: Keys of the other parameters.
    """
    key = keys.LOSSES_DB.name
    if key not in entries:
        return {}
    by_name = entries[key].named(keys.LOSS_NAME)
    if not by_name:
        raise entries[key].error("needs at least one loss")
    for name, entry in by_name.items():
        column = column_name(loss_key(name))
        if column in names:
            raise entry.error(f"must have another name, as {column!r} is a key of the radar")
    return {name: entry.number(LOSSES) for name, entry in by_name.items()}


def read_tolerances(entry: Entry, sheet: DataSheet) -> tuple[Tolerance, ...]:
    """Read standard deviations of parameters, each in the unit of its key.

    Raises:
        InputError: If a key is not in the data sheet, or a number is not allowed.
    """
    losses_key = keys.LOSSES_DB.name
    allowed = [key for key in nest_losses(sheet.values) if key != "coherent_pulses"]
    entries = entry.mapping([], allowed)
    if not entries:
        raise entry.error(f"needs at least one of the keys {', '.join(allowed)}")
    if losses_key in entries:
        losses = entries.pop(losses_key)
        by_name = losses.mapping([], list(nest_losses(sheet.values)[losses_key]))
        if not by_name:
            raise losses.error("needs at least one loss")
        entries |= {loss_key(name): of_loss for name, of_loss in by_name.items()}
    std: dict[str, float] = {}
    for key, value in entries.items():
        (tolerance,) = sheet.tolerances({key: 0.0})
        std[key] = value.number(TOLERANCE_DB if tolerance.decibels else NOT_NEGATIVE)
        most = MAX_DIVISOR_STD * tolerance.value
        if tolerance.power < 0 and not tolerance.decibels and std[key] > most:
            raise value.error(
                f"must be a number not less than 0 and not greater than {most:g}, 1/6 of the "
                f"parameter because c_r is divided by this parameter; got {std[key]:g}"
            )
    return sheet.tolerances(std)
