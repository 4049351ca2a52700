//! Arguments of a script's calls, made into quantities. What does not fit is told with its name, what it is, and what
//! would be right.

use rhai::Dynamic;
use supersigma_config::choose;
use supersigma_protocol::{AxisNumber, Position, Refusal, Tick, Ticks};

use crate::executive::{Displacement, Failure, Knowledge};

use super::trouble::Trouble;

/// The longest span that one call waits.
const LONGEST_WAIT: f64 = 86_400.0;

/// Ticks.
#[expect(clippy::cast_precision_loss, reason = "two million is exact")]
const PER_SECOND: f64 = Tick::PER_SECOND as f64;

/// The two digital cards.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lines {
    Inputs,
    Outputs,
}

/// An axis by its name or its number.
pub(super) fn axis(knowledge: &Knowledge, value: &Dynamic) -> Result<AxisNumber, Trouble> {
    if let Ok(number) = value.as_int() {
        let axis = knowledge.config.find_axis(&number.to_string());
        axis.map(|axis| axis.address).ok_or_else(|| no_axis(knowledge, &number.to_string(), ""))
    } else if let Ok(name) = value.as_immutable_string_ref() {
        named_axis(knowledge, &name)
    } else {
        let found = describe(value);
        Err(Trouble::wrong(format!("an axis is a name or a number, not {found}")))
    }
}

/// One axis or an array of them.
pub(super) fn axes(knowledge: &Knowledge, value: &Dynamic) -> Result<Vec<AxisNumber>, Trouble> {
    let Ok(array) = value.as_array_ref() else {
        return Ok(vec![axis(knowledge, value)?]);
    };
    let mut named = Vec::with_capacity(array.len());
    for value in array.iter() {
        let axis = axis(knowledge, value)?;
        once(knowledge, named.iter(), axis)?;
        named.push(axis);
    }
    Ok(named)
}

/// A map of axes to whole numbers.
pub(super) fn parts(knowledge: &Knowledge, value: &Dynamic) -> Result<Vec<(AxisNumber, i64)>, Trouble> {
    let Ok(map) = value.as_map_ref() else {
        let found = describe(value);
        return Err(Trouble::Wrong {
            message: format!("the axes of a line are a map, not {found}"),
            help: Some("write them as #{ left_x: 7919, left_y: -13 }".into()),
        });
    };
    let mut parts = Vec::with_capacity(map.len());
    for (name, value) in map.iter() {
        let axis = named_axis(knowledge, name)?;
        once(knowledge, parts.iter().map(|(axis, _)| axis), axis)?;
        parts.push((axis, whole(name, value)?));
    }
    Ok(parts)
}

/// The legs of a path, each a map as of a line.
pub(super) fn legs(knowledge: &Knowledge, value: &Dynamic) -> Result<Vec<Vec<(AxisNumber, i64)>>, Trouble> {
    let found = describe(value);
    let Ok(legs) = value.as_array_ref() else {
        return Err(Trouble::wrong(format!("the legs of a path are an array of maps, not {found}")));
    };
    legs.iter().map(|leg| parts(knowledge, leg)).collect()
}

/// A whole number of steps, or a position; `what` is what the signature calls it.
pub(super) fn whole(what: &str, value: &Dynamic) -> Result<i64, Trouble> {
    value.as_int().map_err(|_| {
        let help =
            value.is_float().then(|| "a step is the least that an axis moves; `.to_int()` cuts".into());
        Trouble::Wrong { message: format!("`{what}` must be a whole number, not {}", describe(value)), help }
    })
}

/// Signed steps.
pub(super) fn steps(value: &Dynamic) -> Result<Displacement, Trouble> {
    whole("steps", value).map(Displacement)
}

/// Steps per second.
pub(super) fn speed(value: &Dynamic) -> Result<f64, Trouble> {
    number("speed", value)
}

/// Steps per second, or none.
pub(super) fn ceiling(value: &Dynamic) -> Result<Option<f64>, Trouble> {
    if value.is_unit() {
        return Ok(None);
    }
    Ok(Some(speed(value)?).filter(|speed| *speed != 0.0))
}

/// A span of machine time in seconds, and the same in ticks.
pub(super) fn seconds(what: &str, value: &Dynamic) -> Result<(f64, Ticks), Trouble> {
    let seconds = number(what, value)?;
    if !(0.0..=LONGEST_WAIT).contains(&seconds) {
        let message = format!("`{what}` must be from 0 to {LONGEST_WAIT} seconds, not {seconds}");
        return Err(Trouble::wrong(message));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to a day of ticks")]
    let ticks = (seconds * PER_SECOND).round() as u64;
    Ok((seconds, Ticks(ticks)))
}

/// On or off.
pub(super) fn level(what: &str, value: &Dynamic) -> Result<bool, Trouble> {
    value.as_bool().map_err(|_| {
        let found = describe(value);
        Trouble::wrong(format!("`{what}` must be true or false, not {found}"))
    })
}

/// A line of a digital card by its name or its place.
pub(super) fn line(knowledge: &Knowledge, card: Lines, value: &Dynamic) -> Result<u8, Trouble> {
    let what = match card {
        Lines::Inputs => "input",
        Lines::Outputs => "output",
    };
    if let Ok(place) = value.as_int() {
        let bit = u8::try_from(place).ok().filter(|bit| *bit < 16);
        return bit.ok_or_else(|| {
            Trouble::wrong(format!("there is no {what} {place}, a card has the lines 0 to 15"))
        });
    }
    let Ok(name) = value.as_immutable_string_ref() else {
        let found = describe(value);
        return Err(Trouble::wrong(format!("an {what} is a name or a number, not {found}")));
    };
    let digital = &knowledge.config.digital;
    let lines: Vec<(&str, u8)> = match card {
        Lines::Inputs => digital.inputs.iter().map(|line| (line.name.as_str(), line.bit)).collect(),
        Lines::Outputs => digital.outputs.iter().map(|line| (line.name.as_str(), line.bit)).collect(),
    };
    lines.iter().find(|(called, _)| *called == name.as_str()).map(|(_, bit)| *bit).ok_or_else(|| {
        Trouble::Wrong {
            message: format!("there is no {what} {:?}", name.as_str()),
            help: Some(choose(&name, lines.iter().map(|(name, _)| *name), &format!("the {what}s are"))),
        }
    })
}

/// Whether a position is one that an axis may go to.
pub(super) fn within_travel(knowledge: &Knowledge, axis: AxisNumber, target: i64) -> Result<(), Failure> {
    let config = knowledge.config.axis(axis).ok_or(Failure::NoSuchAxis { axis })?;
    let (min, max) = (config.travel.min, config.travel.max);
    if (i64::from(min.0)..=i64::from(max.0)).contains(&target) {
        return Ok(());
    }
    let nearest = i32::try_from(target).unwrap_or(if target < 0 { i32::MIN } else { i32::MAX });
    Err(Failure::Refused {
        axis,
        refusal: Refusal::OutOfTravel { target: Position(nearest), min, max },
        at: None,
    })
}

/// What a value is, for a sentence that says that it should be something else.
pub(super) fn describe(value: &Dynamic) -> String {
    if let Ok(text) = value.as_immutable_string_ref() {
        format!("the string {:?}", text.as_str())
    } else if value.is_array() {
        "an array".into()
    } else if value.is_map() {
        "a map".into()
    } else if let Ok(number) = value.as_float() {
        format!("the float {number:?}")
    } else if value.is_unit() {
        "()".into()
    } else {
        // Whole numbers, true and false are best shown.
        value.to_string()
    }
}

fn named_axis(knowledge: &Knowledge, name: &str) -> Result<AxisNumber, Trouble> {
    let axis = knowledge.config.find_axis(name);
    axis.map(|axis| axis.address).ok_or_else(|| no_axis(knowledge, &format!("{name:?}"), name))
}

fn no_axis(knowledge: &Knowledge, shown: &str, name: &str) -> Trouble {
    let names = knowledge.config.axes.iter().map(|axis| axis.name.as_str());
    Trouble::Wrong {
        message: format!("there is no axis {shown}"),
        help: Some(choose(name, names, "the axes are")),
    }
}

fn once<'a>(
    knowledge: &Knowledge,
    mut named: impl Iterator<Item = &'a AxisNumber>,
    axis: AxisNumber,
) -> Result<(), Trouble> {
    if named.any(|other| *other == axis) {
        return Err(Trouble::wrong(format!("{} ({axis}) is named twice", knowledge.name(axis))));
    }
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "what is too large for a float is too large for its range")]
fn number(what: &str, value: &Dynamic) -> Result<f64, Trouble> {
    let number = value.as_float().or_else(|_| value.as_int().map(|whole| whole as f64));
    number.ok().filter(|number| number.is_finite()).ok_or_else(|| {
        let found = describe(value);
        Trouble::wrong(format!("`{what}` must be a number, not {found}"))
    })
}
