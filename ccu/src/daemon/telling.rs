//! Requests in words, for the daemon's events. Questions are not told: nothing happens because of them.

use std::fmt::Write;

use supersigma_protocol::AxisNumber;

use crate::executive::{Displacement, Knowledge, Request};

/// What is to be done, in the words of the command line; `None` for what only asks, waits, or is told by the bus.
pub(super) fn telling(request: &Request, knowledge: &Knowledge) -> Option<String> {
    let axes = |what: &str, axes: &[AxisNumber]| {
        let of_all = if axes.is_empty() { " all axes" } else { "" };
        axes.iter().fold(format!("{what}{of_all}"), |text, axis| text + " " + knowledge.name(*axis))
    };
    let parts = |what: &str, parts: &[(AxisNumber, Displacement)]| {
        parts.iter().fold(what.to_owned(), |mut text, (axis, by)| {
            // Writing into a string does not fail.
            let _ = write!(text, " {}={}", knowledge.name(*axis), by.0);
            text
        })
    };
    Some(match request {
        Request::Originate { axes: which } => axes("origin", which),
        Request::SeekReference { axis } => axes("reference", &[*axis]),
        Request::Move { axis, by, .. } => format!("move {} {}", knowledge.name(*axis), by.0),
        Request::Line { parts: which, .. } => parts("line", which),
        Request::Path { legs, .. } => {
            legs.iter().fold("path".to_owned(), |text, leg| text + parts(";", &leg.parts).as_str())
        }
        Request::Resume => "resume".to_owned(),
        Request::Halt { axes: which } => axes("halt", which),
        Request::Brake { axes: which } => axes("brake", which),
        Request::Clear { axes: which } => axes("clear", which),
        Request::Output { bit, on } => format!("output {bit} {}", if *on { "on" } else { "off" }),
        Request::Begin { request, .. } => return telling(request, knowledge),
        Request::Status { .. }
        | Request::Abandon
        | Request::Await { .. }
        | Request::Now
        | Request::Digital { .. }
        | Request::Inject { .. }
        | Request::Wait { .. }
        | Request::Send { .. } => return None,
    })
}

#[cfg(test)]
mod tests {
    use supersigma_config::Config;

    use super::*;
    use crate::executive::Leg;

    #[test]
    fn requests_are_told_in_the_words_of_the_command_line() {
        let knowledge = Knowledge::new(Config::default_set()).expect("the built-in set");
        let [first, second] = [1, 2].map(|number| AxisNumber::new(number).expect("1 to 7"));
        let tell = |request| telling(&request, &knowledge);
        let by = |steps| Displacement(steps);
        let part = vec![(first, by(40)), (second, by(-7))];
        assert_eq!(tell(Request::Originate { axes: vec![] }).as_deref(), Some("origin all axes"));
        assert_eq!(tell(Request::Halt { axes: vec![second, first] }).as_deref(), Some("halt left_y left_x"));
        let request = Request::Move { axis: first, by: by(-12), speed: None, constant: false, wait: true };
        assert_eq!(tell(request).as_deref(), Some("move left_x -12"));
        let request = Request::Line { parts: part.clone(), speed: None, wait: true };
        assert_eq!(tell(request).as_deref(), Some("line left_x=40 left_y=-7"));
        let legs = vec![Leg { parts: part.clone(), speed: None }, Leg { parts: part, speed: None }];
        let request = Request::Path { legs, wait: true };
        assert_eq!(tell(request).as_deref(), Some("path; left_x=40 left_y=-7; left_x=40 left_y=-7"));
        assert_eq!(tell(Request::Output { bit: 3, on: true }).as_deref(), Some("output 3 on"));
        assert_eq!(tell(Request::Status { axes: vec![] }), None);
    }
}
