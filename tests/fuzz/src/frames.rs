//! Frames by chance: from raw bytes, which are seldom a frame, to frames in which only one thing is odd.

use arbitrary::Unstructured;
use supersigma_protocol::{
    Address, Answer, Body, Broadcast, Command, CommandBytes, Direction, Distance, End, Fault, Frame,
    Operation, Sender, Sequence, SpeedIndex, Steps, Switch, Tick, Ticks,
};

use crate::taken;

/// A value of the wire out of raw bytes, if they are one. Postcard takes no more of them than it needs.
fn decoded<T: for<'de> serde::Deserialize<'de>>(chance: &mut Unstructured<'_>) -> Option<T> {
    let rest = chance.peek_bytes(chance.len())?;
    let (value, behind) = postcard::take_from_bytes(rest).ok()?;
    let used = rest.len() - behind.len();
    taken(chance.bytes(used));
    Some(value)
}

/// Up to eight bytes, as somebody may send them.
pub(crate) fn command_bytes(chance: &mut Unstructured<'_>) -> CommandBytes {
    if taken(chance.ratio(1_u8, 3)) {
        let length = taken(chance.int_in_range(0..=CommandBytes::MAX));
        let bytes = chance.bytes(length.min(chance.len())).map(<[u8]>::to_vec);
        return CommandBytes::try_from(taken(bytes)).expect("not too many");
    }
    command(chance).encode()
}

/// A command that is one.
fn command(chance: &mut Unstructured<'_>) -> Command {
    let direction = if taken(chance.arbitrary()) { Direction::Forward } else { Direction::TowardsOrigin };
    let steps: u16 = taken(chance.arbitrary());
    let distance = Distance::new(if taken(chance.arbitrary()) { steps } else { steps % 300 });
    let distance = distance.unwrap_or(Distance::MAX);
    let limit = SpeedIndex::new(taken(chance.arbitrary())).unwrap_or(SpeedIndex::TOP);
    let operation = match taken(chance.int_in_range(0_u8..=15)) {
        0 => Operation::Move { direction, distance },
        1 => Operation::MoveLimited { direction, distance, limit },
        2 => Operation::Slew { direction, distance, speed: limit },
        3 => Operation::Originate,
        4 => Operation::Status,
        5 => Operation::Halt,
        6 => Operation::Brake,
        7 => Operation::SeekReference,
        8 => Operation::Lead { distance, limit: Some(limit) },
        9 => Operation::ArmLine { direction, distance },
        10 => Operation::Go,
        11 => Operation::Rest,
        12 => Operation::Join { limit },
        13 => Operation::Clear,
        14 => Operation::ReadInputs,
        _ => Operation::WriteOutputs { word: steps },
    };
    let to = taken(chance.choose(&[1, 1, 1, 0, 2, 8, 9]));
    Command::new(Address(*to), operation)
}

/// A fault on purpose.
pub(crate) fn fault(chance: &mut Unstructured<'_>) -> Fault {
    match taken(chance.int_in_range(0_u8..=5)) {
        0 => Fault::Force,
        1 => Fault::Limit(End::Lower),
        2 => Fault::Limit(End::Upper),
        3 => Fault::LostSteps(Steps(taken(chance.arbitrary()))),
        4 => Fault::Switch(Switch::StuckOpen),
        _ => Fault::Switch(if taken(chance.arbitrary()) { Switch::Free } else { Switch::StuckClosed }),
    }
}

/// A tick near `now`, or anywhere.
pub(crate) fn tick(chance: &mut Unstructured<'_>, now: Tick) -> Tick {
    match taken(chance.int_in_range(0_u8..=3)) {
        0 => Tick(taken(chance.arbitrary())),
        1 => Tick(now.0.saturating_sub(taken(chance.arbitrary::<u32>()).into())),
        _ => now + Ticks(taken(chance.arbitrary::<u16>()).into()),
    }
}

/// What the CCU may send, with a fitting number or any.
pub(crate) fn of_the_ccu(chance: &mut Unstructured<'_>, due: Sequence, now: Tick) -> Frame {
    let bytes = command_bytes(chance);
    let at = taken(chance.arbitrary::<bool>()).then(|| tick(chance, now));
    let sequence = if taken(chance.ratio(1_u8, 16)) { Sequence(taken(chance.arbitrary())) } else { due };
    Frame { sender: Sender::Ccu, sequence, tick: now, body: Body::Command(Broadcast { bytes, at }) }
}

/// Any frame, if the bytes are one.
pub(crate) fn any(chance: &mut Unstructured<'_>) -> Option<Frame> {
    decoded(chance)
}

/// Any answer, if the bytes are one.
pub(crate) fn answer(chance: &mut Unstructured<'_>) -> Option<Answer> {
    decoded(chance)
}

/// What is on the bus: frames, whatever they say, and bytes that are none.
pub(crate) fn on_the_bus(chance: &mut Unstructured<'_>, now: Tick) -> Vec<u8> {
    let sequence = Sequence(taken(chance.arbitrary::<u8>()).into());
    match taken(chance.int_in_range(0_u8..=7)) {
        0 => {
            let length = taken(chance.int_in_range(0..=40_usize)).min(chance.len());
            taken(chance.bytes(length)).to_vec()
        }
        1 => any(chance).map_or_else(Vec::new, |frame| frame.encode()),
        2 | 3 => Frame { tick: tick(chance, now), ..of_the_ccu(chance, sequence, now) }.encode(),
        _ => {
            let Some(mut answer) = answer(chance) else { return vec![] };
            if taken(chance.ratio(7_u8, 8)) {
                answer.card = Address(answer.card.0 % 10);
            }
            if taken(chance.ratio(3_u8, 4)) {
                answer.acted_at = now;
            }
            let (sender, body) = (Sender::Card(answer.card), Body::Answer(answer));
            Frame { sender, sequence, tick: tick(chance, now), body }.encode()
        }
    }
}
