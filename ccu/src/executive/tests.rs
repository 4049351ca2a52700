//! The executive over a dry set: real cards, real frames, faults on purpose, and no time to wait for.

use std::sync::Arc;
use std::time::Duration;

use supersigma_config::{Config, Feedback, MotorConfig};
use supersigma_protocol::{
    Activity, Alarm, AxisNumber, Broadcast, Fault, Position, Refusal, Sequence, Steps, Switch, Tick, Ticks,
};

use super::{
    Common, Displacement, Executive, Failure, Heard, Knowledge, Link, Movement, Operate, Outcome, Recovery,
    Request,
};
use crate::dry::{DrySet, NoPulses};

fn axis(number: u8) -> AxisNumber {
    AxisNumber::new(number).expect("1 to 7")
}

/// Two axes in closed loop, originated.
fn closed(change: impl FnOnce(&mut Config)) -> Executive<DrySet<NoPulses>> {
    let mut config = Config::default_set();
    for axis in &mut config.axes[..2] {
        axis.motor = Some(MotorConfig::bench());
        axis.feedback = Feedback::Closed;
    }
    change(&mut config);
    let knowledge = Knowledge::new(config).expect("good ramps");
    let mut executive = Executive::new(DrySet::new(knowledge, NoPulses, None).expect("a good set"));
    executive.operate(Request::Originate { axes: vec![axis(1), axis(2)] }).expect("nothing forbids it");
    executive
}

fn lose(executive: &mut Executive<DrySet<NoPulses>>, steps: u32) {
    let fault = Fault::LostSteps(Steps(steps));
    executive.operate(Request::Inject { axis: axis(1), fault }).expect("the card answers");
}

fn go(executive: &mut Executive<DrySet<NoPulses>>, by: i64) -> Result<Movement, Failure> {
    let request =
        Request::Move { axis: axis(1), by: Displacement(by), speed: None, constant: false, wait: true };
    match executive.operate(request)? {
        Outcome::Moved(movements) => Ok(movements[0]),
        other => panic!("a movement, not {other:?}"),
    }
}

#[test]
fn a_few_lost_steps_are_the_cards_own_business() {
    let mut executive = closed(|_| {});
    lose(&mut executive, 40);
    let movement = go(&mut executive, 5_000).expect("made good");
    assert_eq!((movement.position, movement.recovered), (Some(Position(5_000)), None));
}

#[test]
fn a_shaft_that_did_not_follow_is_tried_again() {
    let mut executive = closed(|_| {});
    lose(&mut executive, 110);
    let movement = go(&mut executive, 5_000).expect("the second try");
    assert_eq!((movement.position, movement.recovered), (Some(Position(5_000)), Some(Recovery::TriedAgain)));
    assert_eq!((movement.asked, movement.done), (Some(Displacement(5_000)), Steps(5_000)));
    assert!(movement.sense.is_closed_loop_success(), "{:?}", movement.sense);
}

#[test]
fn what_a_second_try_does_not_mend_the_reference_step_does() {
    let mut executive = closed(|_| {});
    go(&mut executive, 3_000).expect("nothing is wrong yet");
    lose(&mut executive, 210);
    let movement = go(&mut executive, 5_000).expect("from the reference step");
    assert_eq!(
        (movement.position, movement.recovered),
        (Some(Position(8_000)), Some(Recovery::SoughtReference))
    );
}

#[test]
fn when_nothing_helps_it_says_what_was_tried() {
    let mut executive = closed(|_| {});
    let fault = Fault::Switch(Switch::StuckOpen);
    executive.operate(Request::Inject { axis: axis(1), fault }).expect("the card answers");
    lose(&mut executive, 210);
    let failure = go(&mut executive, 5_000).expect_err("nothing helps");
    let text = failure.to_string();
    assert!(matches!(failure, Failure::GaveUp { .. }), "{text}");
    assert!(text.contains("the limit switch did not close"), "{text}");
    assert!(text.contains("the executive tried again, and sought the reference step"), "{text}");
}

#[test]
fn who_does_not_want_it_mended_gets_the_failure() {
    let mut executive = closed(|config| config.executive.recover = false);
    lose(&mut executive, 110);
    let failure = go(&mut executive, 5_000).expect_err("nobody mends it");
    assert!(matches!(failure, Failure::Alarm { alarm: Alarm::FollowingError(_), .. }), "{failure}");
}

#[test]
fn axes_with_different_ramps_do_not_go_on_a_line() {
    let mut executive = closed(|config| {
        let slower = supersigma_config::Sin2 { amplitude: 12_000.0, ..Default::default() };
        config.axes[1].ramp = Some(slower.into());
    });
    let parts = vec![(axis(1), Displacement(100)), (axis(2), Displacement(100))];
    let failure =
        executive.operate(Request::Line { parts, speed: None, wait: true }).expect_err("they differ");
    assert_eq!(failure, Failure::DifferentRamps { one: axis(1), other: axis(2) });
    assert_eq!(failure.exit_code(), 2);
}

/// A link that holds the start of a line back until its start tick has passed.
struct HeldUp(DrySet<NoPulses>);

impl Link for HeldUp {
    fn knowledge(&self) -> &Arc<Knowledge> {
        self.0.knowledge()
    }
    fn now(&self) -> Tick {
        self.0.now()
    }
    fn ticks(&self, real: Duration) -> Ticks {
        self.0.ticks(real)
    }
    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure> {
        if let Some(start) = broadcast.at {
            while self.0.hear(start + Ticks(7))?.is_some() {}
        }
        self.0.send(broadcast)
    }
    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Sequence, Failure> {
        self.0.inject(axis, fault)
    }
    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        self.0.hear(until)
    }
    fn common(&self) -> Arc<Common> {
        self.0.common()
    }
    fn tell_resume(&self) {
        self.0.tell_resume();
    }
}

#[test]
fn a_line_whose_start_comes_too_late_moves_nobody() {
    let knowledge = Knowledge::new(Config::default_set()).expect("good ramps");
    let set = DrySet::new(knowledge, NoPulses, None).expect("a good set");
    let mut executive = Executive::new(HeldUp(set));
    executive.operate(Request::Originate { axes: vec![axis(1), axis(2)] }).expect("nothing forbids it");
    let parts = vec![(axis(1), Displacement(500)), (axis(2), Displacement(300))];
    let failure = executive.operate(Request::Line { parts, speed: None, wait: true }).expect_err("late");
    assert!(matches!(failure, Failure::Refused { refusal: Refusal::Late { by: Ticks(7) }, .. }), "{failure}");
    let Ok(Outcome::Axes(states)) = executive.operate(Request::Status { axes: vec![axis(1), axis(2)] })
    else {
        panic!("the cards answer");
    };
    for state in states {
        let report = state.report.expect("alive");
        assert_eq!((report.activity, report.position), (Activity::Standing, Some(Position(0))));
    }
}

/// A link whose client goes away while it waits for the answer to one kind of command.
struct HangsUp {
    set: DrySet<NoPulses>,
    on: u8,
    gone: bool,
}

impl Link for HangsUp {
    fn knowledge(&self) -> &Arc<Knowledge> {
        self.set.knowledge()
    }
    fn now(&self) -> Tick {
        self.set.now()
    }
    fn ticks(&self, real: Duration) -> Ticks {
        self.set.ticks(real)
    }
    fn send(&mut self, broadcast: Broadcast) -> Result<Sequence, Failure> {
        self.gone |= broadcast.bytes.as_slice().get(1) == Some(&self.on);
        self.set.send(broadcast)
    }
    fn inject(&mut self, axis: AxisNumber, fault: Fault) -> Result<Sequence, Failure> {
        self.set.inject(axis, fault)
    }
    fn hear(&mut self, until: Tick) -> Result<Option<Heard>, Failure> {
        if std::mem::take(&mut self.gone) { Err(Failure::Cancelled) } else { self.set.hear(until) }
    }
    fn common(&self) -> Arc<Common> {
        self.set.common()
    }
    fn tell_resume(&self) {
        self.set.tell_resume();
    }
}

#[test]
fn what_begins_while_its_client_goes_away_is_halted() {
    let by = Displacement(5_000);
    let line = Request::Line { parts: vec![(axis(1), by), (axis(2), by)], speed: None, wait: true };
    let slow = Request::Move { axis: axis(1), by, speed: None, constant: false, wait: true };
    for (request, op_code) in [(slow, 0x01), (line.clone(), 0x0A), (line, 0x0B)] {
        let knowledge = Knowledge::new(Config::default_set()).expect("good ramps");
        let set = DrySet::new(knowledge, NoPulses, None).expect("a good set");
        let mut executive = Executive::new(HangsUp { set, on: op_code, gone: false });
        executive.operate(Request::Originate { axes: vec![axis(1), axis(2)] }).expect("nothing forbids it");
        assert_eq!(executive.operate(request), Err(Failure::Cancelled), "{op_code:02X}");
        executive.operate(Request::Wait { ticks: Ticks::from_millis(5_000) }).expect("time passes");
        let Ok(Outcome::Axes(states)) = executive.operate(Request::Status { axes: vec![axis(1), axis(2)] })
        else {
            panic!("the cards answer");
        };
        for state in states {
            let report = state.report.expect("alive");
            assert_eq!(report.activity, Activity::Standing, "{op_code:02X}");
            assert!(
                report.position.is_some_and(|position| position < Position(10)),
                "{op_code:02X}: {report:?}"
            );
        }
    }
}

/// What two axes do once axis 1 has been braked at `after` of a line.
fn braked_on_a_line(after: Option<Ticks>) -> [(Option<Alarm>, Result<Outcome, Failure>); 2] {
    let knowledge = Knowledge::new(Config::default_set()).expect("good ramps");
    let mut executive = Executive::new(DrySet::new(knowledge, NoPulses, None).expect("a good set"));
    let axes = [axis(1), axis(2)];
    executive.operate(Request::Originate { axes: axes.to_vec() }).expect("nothing forbids it");
    let parts = vec![(axis(1), Displacement(5_000)), (axis(2), Displacement(3_000))];
    executive.operate(Request::Line { parts, speed: None, wait: after.is_none() }).expect("both are ready");
    if let Some(ticks) = after {
        executive.operate(Request::Wait { ticks }).expect("time passes");
    }
    executive.operate(Request::Brake { axes: vec![axis(1)] }).expect("it stands in the end");
    axes.map(|axis| {
        let Ok(Outcome::Axes(states)) = executive.operate(Request::Status { axes: vec![axis] }) else {
            panic!("the card answers");
        };
        let by = Displacement(10);
        let moved = executive.operate(Request::Move { axis, by, speed: None, constant: false, wait: true });
        (states[0].report.expect("alive").alarm, moved)
    })
}

#[test]
fn a_brake_locks_the_others_of_a_line_only_while_it_is_made() {
    let [(alarm, moved), (other, free)] = braked_on_a_line(None);
    assert_eq!((alarm, other), (Some(Alarm::Braked), None));
    assert!(matches!(moved, Err(Failure::Refused { refusal: Refusal::InAlarm, .. })), "{moved:?}");
    assert!(matches!(free, Ok(Outcome::Moved(_))), "{free:?}");
    // On the way, whoever is on the line stops too: armed already, at speed, and just before the end.
    for milliseconds in [0, 10, 300] {
        let both = braked_on_a_line(Some(Ticks::from_millis(milliseconds)));
        assert_eq!(both.map(|(alarm, _)| alarm), [Some(Alarm::Braked); 2], "after {milliseconds} ms");
    }
}
