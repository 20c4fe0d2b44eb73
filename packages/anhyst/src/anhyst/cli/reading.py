"""The options for reading measurements, which every command with ``**reading`` has."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from anhyst.data.clean import ReadOptions
    from anhyst.support.atomic import PathLike


def read_options(
    columns: str | None = None,
    sidecar: PathLike | None = None,
    schedule: str | None = None,
    loop: str | None = None,
    constants: str | None = None,
    history: str | None = None,
    clean: str | None = None,
    scale: str | None = None,
    flip: str | None = None,
    drop: str | None = None,
) -> ReadOptions:
    """Return the settings for reading measurements from the texts of the command line.

    Parameters
    ----------
    columns : str, ``FILE=OURS,...``
        Meaning of columns whose headers do not state it, such as 'I_A_scaled=I_A,U_M_V=psi_Wb'.
        An empty right side leaves a column out. A name with a comma needs double quotes:
        '"Current, coil (A)"=I_A'.
    sidecar : path-like, ``FILE``
        TOML file with information that is not in the headers (columns, history, ...). [default: a
        .toml of the same name next to each file]
    schedule : str, ``NAME``
        Quantity or column on which the parameters depend.
    loop : str, ``COLUMN``
        Column that distinguishes loops.
    constants : str, ``OURS=VALUE,...``
        Constant values that are not in a column, such as 'gap_mm=0.4'.
    history : str, ``HISTORY``
        What happened before the first sample: 'demagnetised', 'settled' (a cycle that was
        repeated), or 'conditioned:0,2,0' (reversal points of the input in SI units). [default: as
        in the sidecar, or proposed for each record]
    clean : str, ``STEP,...``
        Cleaning steps: dedupe, spikes, steady, drift, offset, skew, holes, ripple, denoise, thin;
        or 'none'. [default: dedupe,holes,ripple,denoise,thin]
    scale : str, ``NAME=FACTOR,...``
        Value in our unit per unit in the file, such as 'CH1=10' for a probe of 10 A per V.
    flip : str, ``NAME,...``
        Columns whose sign is reversed, such as 'F_N'.
    drop : str, ``invalid``
        Leave out samples without a measured value: NaN, infinity, overrange marks, and samples
        that the recorder marks as invalid. Their number is reported.
    """
    from anhyst.data.clean import ReadOptions

    return ReadOptions.from_text(
        columns=columns,
        sidecar=None if sidecar is None else str(sidecar),
        schedule=schedule,
        loop=loop,
        constants=constants,
        history=history,
        clean=clean,
        scale=scale,
        flip=flip,
        drop=drop,
    )
