"""Sections of the report about the model: parameters, reduction, gap map, laws, origin."""

from __future__ import annotations

import math
from collections.abc import Mapping

from markupsafe import Markup

from anhyst.data.clean import SETTING_PREFIX
from anhyst.model.actuator import Model
from anhyst.model.dynamics import EddyCircuit
from anhyst.model.schema import CrossValidation, Uncertainty
from anhyst.reports.figures import figure_correlation, figure_reduction
from anhyst.reports.figures_over_schedule import (
    DRIVE_SHARES,
    figure_between_gaps,
    figure_parameters,
    nodes_and_midpoints,
    parameter_unit,
    varying_parameters,
)
from anhyst.reports.subject import ModelSubject, acceptance_note
from anhyst.support.page import (
    GREEK_LETTERS,
    NBSP,
    Block,
    Cell,
    Items,
    Note,
    Section,
    Text,
    choose_scale,
    format_deviation,
    format_number,
    format_percent,
    make_table,
    typeset,
)
from anhyst.support.wording import capitalise

GAP_MAP_TEXTS: Mapping[str, str] = {
    "none": "No parameter depends on the scheduling variable.",
    "scaling": "The iron has the same parameters at all scheduling values. Only the factor from input to "
    "field (c_H) depends on the scheduling variable, as in the paper.",
    "reluctance": "The iron, which causes the hysteresis, has the same parameters at all scheduling "
    "values. Only the series reluctance ρ depends on the scheduling variable, as for an air gap.",
    "circuit": "The iron, which causes the hysteresis, has the same parameters at all scheduling values. "
    "The series reluctance, the output per flux and the offsets depend on the scheduling variable.",
    "free": "All parameters can depend on the scheduling variable, including those of the iron. This "
    "map is for fixed values only.",
}

QUANTITY_MEANINGS: Mapping[str, str] = {
    "k/a": "pinning parameter k relative to the shape parameter a; it determines the loop width",
    "(w*M_s)/a": "feedback of the flux on the iron (circuit and interaction)",
    "a/c_H": "input at the knee of the magnetisation curve",
    "output at saturation": "output with all magnetisation aligned",
    "input offset": "input at which the field in the iron is zero",
    "output offset": "output at zero flux",
    "gamma": "lag of the flux inside solid iron",
    "c": "reversible fraction of the magnetisation",
}
"""Meaning of the fitted quantities, by the beginning of their names. The first match is used."""


def section_parameters_over(subject: ModelSubject) -> Section | None:
    """Return the section with parameters over the scheduling variable (paper, Figs. 1 and 4)."""
    model = subject.model
    figure = figure_parameters(model)
    if figure is None:
        return None
    varying_names, scale = (
        ", ".join(model.file_keys[name][0] for name in varying_parameters(model)),
        subject.schedule_scale,
    )
    nodes = ", ".join(scale.format(node, 4, is_short=True) for node in model.nodes)
    alt = (
        f"{varying_names} over the {subject.schedule_name}: dots at the nodes {nodes} {scale.unit}, a smooth "
        "curve between them that does not overshoot."
    )
    caption = (
        f"Parameters over the {subject.schedule_name}: dots at the measured values, and the curve that the model "
        "uses between them. The curve cannot overshoot, and is a straight line outside."
    )
    head = [scale.heading(subject.schedule_name)]
    columns = [[scale.format(node, 5, is_short=True) for node in model.nodes]]
    for name in varying_parameters(model):
        values = model.interpolate_parameter(name, model.nodes).tolist()
        scale = choose_scale(parameter_unit(model, name), values)
        head.append(Markup(scale.heading("{}")).format(symbol_markup(model.file_keys[name][0])))
        columns.append([scale.format(value, 5) for value in values])
    blocks: tuple[Block, ...] = (
        Text(GAP_MAP_TEXTS[model.gap_map]),
        subject.picture(figure, alt, caption),
        make_table("At the nodes", head, list(zip(*columns, strict=True)), texts=0),
    )
    return Section("parameters-over", f"Parameters over the {subject.schedule_name}", blocks)


def section_reduction(subject: ModelSubject) -> Section | None:
    """Return the section with the cost of each reduction step (paper, section II.D)."""
    steps = subject.model.reduction
    if not steps:
        return None
    first_cost, last_cost = steps[0].cost_before, steps[-1].cost_after
    names = {
        name: GREEK_LETTERS.get(short_name, short_name)
        for name, (short_name, _) in subject.model.file_keys.items()
    }
    text = (
        f"After the best sets for each {subject.schedule_name or 'node'} were found, one parameter after "
        "the other was fixed at its mean, and the others were fitted again. In each round, each "
        "remaining parameter was tried, and the one with the smallest cost was fixed. The mean deviation "
        f"is {format_percent(first_cost)} with all parameters free and {format_percent(last_cost)} with only the "
        "last parameter free."
    )
    largest_cost = max(step.cost_after for step in steps)
    rows: list[list[str | Cell]] = []
    for number, step in enumerate(steps, start=1):
        costs = sorted((cost, name) for name, cost in step.candidates.items())
        alternatives = [(cost, names.get(name, name)) for cost, name in costs if name != step.frozen]
        alternatives_text = ", ".join(f"{name} {_format_cost(cost)}" for cost, name in alternatives)
        fixed_cell = Cell(names.get(step.frozen, step.frozen), strong=True)
        bar = step.cost_after / largest_cost if largest_cost else None
        after_cell = Cell(format_percent(step.cost_after, 3), bar=bar)
        cost_increase = format_percent(step.cost_after - step.cost_before, 2)
        before_text = format_percent(step.cost_before, 3)
        rows.append(
            [str(number), fixed_cell, alternatives_text or "none", before_text, after_cell, cost_increase]
        )
    head = ["round", "fixed", "instead of", "before", "after", "rise"]
    step_texts = (
        f"{format_percent(step.cost_after)} after fixing {names.get(step.frozen, step.frozen)}"
        for step in steps
    )
    bars_text = "; ".join([f"{format_percent(first_cost)} with all parameters free", *step_texts])
    alt = f"Bar chart of the mean deviation: {bars_text}."
    caption = (
        "Mean deviation, relative to the largest output, after each round (bars); rings: "
        "cost of fixing another parameter instead."
    )
    blocks = (
        Text(text),
        subject.picture(figure_reduction(steps, names), alt, caption),
        make_table(
            "Cost of each round", head, rows, "Alternatives with the smallest cost come first.", texts=3
        ),
    )
    return Section("reduction", "Cost of each reduction step", blocks)


def _format_cost(cost: float) -> str:
    return format_percent(cost) if math.isfinite(cost) else "cannot be computed"


def section_between_nodes(subject: ModelSubject) -> Section | None:
    """Return the section with loops at and between nodes (paper, Figs. 2, 5) and acceptance test."""
    model = subject.model
    check = subject.acceptance.over_gap
    figure = figure_between_gaps(model, check)
    if figure is None:
        return None
    schedule_scale, input_scale = subject.schedule_scale, subject.input_scale
    schedule_text = ", ".join(
        schedule_scale.format(node, 4, is_short=True) for node, _ in nodes_and_midpoints(model)
    )
    largest_drive = max(map(abs, model.valid_range.input))
    drive_texts = ", ".join(input_scale.format(fraction * largest_drive, 3) for fraction in DRIVE_SHARES)
    alt = (
        f"Left: steady-state loops of the model at {subject.schedule_name} {schedule_text} {schedule_scale.unit}, "
        f"nodes solid, "
        f"midpoints dashed. Right: {subject.output_name} over the {subject.schedule_name} at fixed "
        f"{subject.input_name}, {drive_texts} {input_scale.unit}, on both branches."
    )
    caption = (
        f"Left: steady-state loops at the nodes (solid) and half-way between (dashed), where nothing "
        f"was fitted: each must lie between its neighbours. Right: {subject.output_name} at a fixed "
        f"{subject.input_name} over the {subject.schedule_name}, dots at the nodes."
    )
    if check is not None:
        caption += f" The {subject.output_name} has to fall from left to right, on both branches."
    blocks: list[Block] = [subject.picture(figure, alt, caption)]
    if check is not None:
        blocks.insert(0, acceptance_note(subject))
    nodes = "reference gaps" if subject.schedule_name == "gap" else f"nodes of the {subject.schedule_name}"
    return Section("between", f"Loops at and between the {nodes}", tuple(blocks))


def section_gap_map(subject: ModelSubject) -> Section | None:
    """Return the section that compares gap maps by their error at withheld gaps."""
    model = subject.model
    withheld_errors = dict(model.fit.left_out) if model.fit else {}
    reason = str(model.provenance.settings.get("gap_map_reason", ""))
    if model.schedule is None or len(model.nodes) < 2 or not (withheld_errors or reason):
        return None
    blocks: list[Block] = []
    if reason:
        reason = reason.replace("inf %", "cannot be computed")
        blocks.append(Text(capitalise(reason) + "."))
    if withheld_errors:
        finite_errors = [error for error in withheld_errors.values() if math.isfinite(error)]
        largest_error = max(finite_errors) if len(finite_errors) > 1 else 0.0
        rows = [
            [
                Cell(name, strong=name == model.gap_map),
                Cell("chosen" if name == model.gap_map else ""),
                Cell(
                    _format_cost(error),
                    bar=error / largest_error if math.isfinite(error) and largest_error else None,
                ),
            ]
            for name, error in sorted(withheld_errors.items(), key=lambda pair: pair[1])
        ]
        caption = (
            f"Mean deviation at a withheld {subject.schedule_name}, predicted from "
            f"the others, relative to {subject.full_scale_text}. Mean of all inner values that were withheld in turn."
        )
        head = ["map", "", "mean deviation"]
        blocks.append(make_table("Cross-validation error of each map", head, rows, caption, texts=2))
    if model.fit and model.fit.cross_validation:
        blocks.append(Text(_expected_error_text(subject, model.fit.cross_validation)))
    return Section("gap-map", f"Comparison of maps for the {subject.schedule_name}", tuple(blocks))


def section_laws(subject: ModelSubject) -> Section | None:
    """Return the section that compares hysteresis laws by their error at withheld data."""
    fit = subject.model.fit
    if fit is None or not fit.candidates:
        return None
    reason = str(subject.model.provenance.settings.get("law_reason", ""))
    errors = [candidate.left_out for candidate in fit.candidates if candidate.left_out is not None]
    largest_error = max(errors, default=0.0)
    rows: list[list[str | Cell]] = []
    for candidate in fit.candidates:
        rms, error = "" if candidate.rms is None else format_percent(candidate.rms), Cell("")
        if candidate.left_out is not None:
            error = Cell(
                format_percent(candidate.left_out),
                bar=candidate.left_out / largest_error if largest_error else None,
            )
        law = Cell(candidate.law, strong=candidate.note == "chosen")
        rows.append([law, candidate.gap_map, candidate.note, str(candidate.numbers), rms, error])
    caption = (
        "Number of fitted parameters; rms deviation from all loops; mean deviation at gaps or loops "
        "that were withheld from the fit in turn. The simpler law is chosen unless the other one is "
        f"better by more than its scatter. In % of {subject.full_scale_text}."
    )
    head = ["law", "map", "", "parameters", "rms deviation", "withheld"]
    reason_text = Text(capitalise(reason) + ".")
    law_table = make_table("Laws compared", head, rows, caption, texts=3)
    return Section("laws", "Comparison of hysteresis laws", (reason_text, law_table))


def _expected_error_text(subject: ModelSubject, validation: CrossValidation) -> str:
    """Return sentences about the expected error from nested cross-validation.

    The smallest error among several candidates would be optimistic.
    """
    fold_errors = ", ".join(format_percent(error) for error in validation.folds)
    if validation.left_out == "block":
        return (
            f"Expected at other samples of such loops: mean deviation {format_percent(validation.error)} of the "
            f"largest {subject.output_name}, in nine of ten cases {format_percent(validation.interval[0])} to "
            f"{format_percent(validation.interval[1])}. The "
            f"errors ({fold_errors}) are from cross-validation: blocks of samples were withheld from "
            "the fit and the choice of the law. They do not apply to loops of other sizes."
        )
    return (
        f"Expected at a {subject.schedule_name} between those measured: mean deviation "
        f"{format_percent(validation.error)} of {subject.full_scale_text}, in nine of ten cases "
        f"{format_percent(validation.interval[0])} to {format_percent(validation.interval[1])}. The "
        f"errors ({fold_errors}) are from cross-validation: each {subject.schedule_name} was withheld "
        "from the fit, the choice of the map and the decision about offsets. They do not include the "
        "noise of the sensor."
    )


def section_parameters(subject: ModelSubject) -> Section:
    """Return the section with all parameters, their units and meanings, and their uncertainty."""
    model = subject.model
    names = model.file_keys
    rows: list[list[str | Cell]] = []
    for name, spec in model.specs.items():
        values = model.parameters[name]
        all_values = values if isinstance(values, tuple) else (values,)
        scale = choose_scale(parameter_unit(model, name), all_values)
        text = scale.format(all_values[0], 5, is_short=True)
        if name in varying_parameters(model):
            text = f"{scale.format(min(all_values), 5)} to {scale.format(max(all_values), 5)}"
        meaning = spec.meaning
        if name == "rho" and subject.schedule_name != "gap":
            meaning = "reluctance in series with the iron, relative to an air-filled iron path"
        short_name, key = names[name]
        text = f"{text}{NBSP}{scale.unit}".strip()
        rows.append([symbol_markup(short_name), Cell(key, code=True), meaning, text])
    blocks: list[Block] = [
        Text(f"Law: {model.operator_law.title}. The parameters are only valid for this law."),
        Text(equations_markup(subject)),
        make_table("All parameters", ["", "in the file", "meaning", "value"], rows, "", texts=3),
    ]
    if model.cells is not None:
        blocks.append(_cell_table(model))
    if model.uncertainty is not None and model.uncertainty.names:
        blocks += _uncertainty_blocks(subject, model.uncertainty)
    return Section("parameters", "Parameters and their uncertainty", tuple(blocks))


def _cell_table(model: Model) -> Block:
    """Return a table of the cell weights, one row for each threshold."""
    cells = model.cells
    assert cells is not None
    rows = [
        [f"{threshold:.4g}", *(f"{100.0 * weight / cells.saturation:.3g}" for weight in row)]
        for threshold, row in zip(cells.thresholds.tolist(), cells.weights.tolist(), strict=True)
    ]
    texts = [f" around {centre:.4g}" * (centre > 0.0) for centre in cells.curve_centres.tolist()]
    heads = [f"width {width:.4g} A/m{text} (%)" for width, text in zip(cells.widths, texts, strict=True)]
    heads.insert(0, "threshold (A/m)")
    return make_table(
        f"Cells: {cells}; weights in % of the saturation magnetisation, {cells.saturation:.5g} A/m",
        heads,
        rows,
    )


def equations_markup(subject: ModelSubject) -> Markup:
    """Return the equations of input and output, without terms that are zero."""
    model = subject.model
    names = {name: symbol_markup(short_name) for name, (short_name, _) in model.file_keys.items()}
    input_symbol, output_symbol = symbol_markup(model.input.symbol), symbol_markup(model.output.symbol)

    def is_nonzero(name: str) -> bool:
        values = model.parameters[name]
        return any(values) if isinstance(values, tuple) else bool(values)

    # The field and flux density of the iron need other symbols if input or output use H or B.
    field_symbol = symbol_markup("H_iron" if model.input.symbol == "H" else "H")
    flux_symbol = symbol_markup("B_iron" if model.output.symbol == "B" else "B")
    left_side = Markup("{} − {}").format(input_symbol, names["in_0"]) if is_nonzero("in_0") else input_symbol
    if model.parameters["c_H"] != 1.0:
        product_form = "{} · ({})" if is_nonzero("in_0") else "{} · {}"
        left_side = Markup(product_form).format(names["c_H"], left_side)
    right_side = field_symbol
    if is_nonzero("rho"):
        right_side += Markup(" + {} · {}/µ<sub>0</sub>").format(names["rho"], flux_symbol)
    if is_nonzero("gamma"):
        right_side += _eddy_markup(model.eddy_circuit or EddyCircuit(), names["gamma"], flux_symbol)
    output = Markup("{}{}").format(flux_symbol, Markup("<sup>2</sup>") if model.power == 2 else "")
    if model.parameters["c_out"] != 1.0:
        output = Markup("{} · {}").format(names["c_out"], output)
    if is_nonzero("out_0"):
        output += Markup(" + {}").format(names["out_0"])
    return Markup('<span class="formula">{} = {}</span> <span class="formula">{} = {}</span>').format(
        left_side, right_side, output_symbol, output
    )


def _eddy_markup(circuit: EddyCircuit, gamma_symbol: Markup, flux_symbol: Markup) -> Markup:
    """Return the terms of the eddy currents; Z is the flux density inside a ring with leakage flux."""
    rate = Markup("d{}/d<i>t</i>").format(flux_symbol)
    terms = Markup(" + {} · {}").format(gamma_symbol, rate)
    if circuit.leaky > 0.0:
        terms = Markup(" + {} · ({:.3g} {} + {:.3g} d<i>Z</i>/d<i>t</i>)").format(
            gamma_symbol, 1.0 - circuit.leaky, rate, circuit.leaky
        )
    if circuit.excess > 0.0:
        terms += Markup(" ± {:.3g} √|{}|").format(circuit.excess, rate)
    return terms


def symbol_markup(name: str) -> Markup:
    """Return a symbol with its subscript and Greek letters."""
    base_symbol, _, index = name.partition("_")
    base_markup = Markup("<i>{}</i>").format(GREEK_LETTERS.get(base_symbol, base_symbol))
    return (
        base_markup + Markup("<sub>{}</sub>").format(GREEK_LETTERS.get(index, index))
        if index
        else base_markup
    )


def _uncertainty_blocks(subject: ModelSubject, uncertainty: Uncertainty) -> list[Block]:
    rows: list[list[str | Cell]] = []
    meaning_in_previous_row = ""
    fitted_parameters = zip(uncertainty.names, uncertainty.values, uncertainty.std, strict=True)
    for index, (name, value, deviation) in enumerate(fitted_parameters, start=1):
        relative = deviation / abs(value) if value and "offset" not in name else None
        meaning = next((text for prefix, text in QUANTITY_MEANINGS.items() if name.startswith(prefix)), "")
        share = Cell(format_percent(relative), strong=relative is not None and relative > 0.2)
        shown_meaning = "" if meaning == meaning_in_previous_row else meaning
        rows.append([str(index), typeset(name), shown_meaning, format_deviation(value, deviation), share])
        meaning_in_previous_row = meaning
    caption = (
        "The fitted quantities are combinations of parameters that the data determine. "
        "Single parameters can compensate each other. The standard deviation treats the error of "
        "the law as noise; values above 20\N{NO-BREAK SPACE}% are bold."
    )
    head = ["no.", "quantity", "meaning", "estimate", "uncertain by"]
    title = "Fitted quantities and their uncertainty"
    blocks: list[Block] = [make_table(title, head, rows, caption, texts=3)]
    if uncertainty.correlation:
        caption = (
            "Correlations of the fitted quantities. Dark blue: both can only increase together; dark "
            "red: one increases as the other decreases; white: independent."
        )
        blocks.append(
            subject.picture(figure_correlation(uncertainty), _correlation_text(uncertainty), caption)
        )
    if uncertainty.statements:
        statements = (typeset(text) for text in uncertainty.statements)
        blocks.append(Items("What the data do not determine", tuple(statements)))
    return blocks


def _correlation_text(uncertainty: Uncertainty) -> str:
    """Return the alternative text of the heat map: the strongest correlations."""
    correlations = sorted(
        (
            (abs(value), uncertainty.names[row], uncertainty.names[column], value)
            for row, values in enumerate(uncertainty.correlation)
            for column, value in enumerate(values[:row])
            if math.isfinite(value)
        ),
        reverse=True,
    )
    correlation_texts = (
        f"{first_name} with {second_name} {format_number(value, 3)}"
        for _, first_name, second_name, value in correlations[:3]
    )
    strongest_text = "; ".join(correlation_texts)
    text = f"Heat map of {len(uncertainty.names)} by {len(uncertainty.names)} correlations"
    return f"{text}, the strongest: {strongest_text}." if strongest_text else f"{text}."


def section_origin(subject: ModelSubject, file_name: str, file_hash: str) -> Section:
    """Return the section about the origin of the model: files, hashes, settings and version."""
    model, provenance = subject.model, subject.model.provenance
    rows = [[Cell(file_name), Cell(file_hash, code=True), Cell("this model")]]
    rows += [
        [
            Cell(source.path),
            Cell(source.sha256, code=True),
            Cell(
                ", ".join(
                    f"{quantity_name} from {column_name}"
                    for column_name, quantity_name in source.columns.items()
                )
            ),
        ]
        for source in provenance.sources
    ]
    blocks: list[Block] = []
    if subject.missing_reason:
        blocks.append(Note("warn", "Not read", f"{subject.missing_reason}."))
    blocks.append(make_table("Files", ["file", "SHA-256", "columns"], rows, texts=3))
    settings = {
        "written by": f"anhyst {provenance.version}" if provenance.version else "",
        "seed of the search": "" if provenance.seed is None else str(provenance.seed),
        "law": model.law,
        "gap map": model.gap_map if model.schedule else "",
        "history before the first sample": str(model.history),
    }
    settings |= {
        _setting_name(key): str(value).lower() if isinstance(value, bool) else str(value)
        for key, value in provenance.settings.items()
        if key != "gap_map_reason"
    }
    rows = [[Cell(name), Cell(value, code=True)] for name, value in settings.items() if value]
    blocks.append(make_table("Settings of the search", ["setting", "value"], rows, texts=2))
    return Section("origin", "Origin of the model", tuple(blocks))


def _setting_name(key: str) -> str:
    name = key.removeprefix(SETTING_PREFIX).replace("_", " ")
    return f"reading: {name}" if key.startswith(SETTING_PREFIX) else name
