//! Robot programs by chance: everything that the language can move, on the built-in set. The same seed gives the same
//! programs.

use fastrand::Rng;
use supersigma_config::Config;
use supersigma_protocol::AxisNumber;

/// Writes one program after the other for one set, and knows where each of them leaves the axes.
#[derive(Debug)]
pub struct Programmer {
    chance: Rng,
    axes: Vec<Axis>,
    /// How far from the origin the programs go.
    reach: i64,
}

#[derive(Debug)]
struct Axis {
    number: AxisNumber,
    name: String,
    max: i64,
    /// The position of the reference step.
    reference: i64,
    /// Where it will be; `None` if it must be originated first.
    at: Option<i64>,
}

/// A program.
#[derive(Debug)]
pub struct Program {
    /// Its text. It prints `step 1`, `step 2` and so on before its steps, and `over` at its end.
    pub text: String,
    /// How many steps it has.
    pub steps: usize,
}

impl Programmer {
    /// For the built-in set, just switched on. Programs stay within `reach` steps of the origins.
    ///
    /// # Panics
    /// If the built-in set has no axes, which it has.
    #[must_use]
    pub fn new(seed: u64, reach: i64) -> Self {
        let axes = Config::default_set().axes.into_iter().map(|axis| Axis {
            number: axis.address,
            max: reach.min(axis.travel.max.0.into()),
            // Position 0 is the first step out of the lower zone.
            reference: i64::from(axis.rail.reference.0) - i64::from(axis.rail.lower_zone.0) - 1,
            name: axis.name,
            at: None,
        });
        Self { chance: Rng::with_seed(seed), axes: axes.collect(), reach }
    }

    /// Where a program that came to its end has left the axes.
    pub fn positions(&self) -> impl Iterator<Item = (AxisNumber, Option<i64>)> {
        self.axes.iter().map(|axis| (axis.number, axis.at))
    }

    /// Where axes are, is not known any more: the next program originates them all.
    pub fn forget(&mut self) {
        self.axes.iter_mut().for_each(|axis| axis.at = None);
    }

    /// The next program, with so many steps.
    #[must_use]
    pub fn program(&mut self, steps: usize) -> Program {
        let lost: Vec<_> = self.axes.iter_mut().filter(|axis| axis.at.is_none()).collect();
        let names: Vec<_> = lost.iter().map(|axis| format!("\"{}\"", axis.name)).collect();
        let mut text = String::new();
        if !lost.is_empty() {
            text += &format!("origin([{}]);\n", names.join(", "));
        }
        lost.into_iter().for_each(|axis| axis.at = Some(0));
        for step in 1..=steps {
            text += &format!("print(\"step {step}\");\n{}\n", self.step());
        }
        text += "print(\"over\");\n";
        Program { text, steps }
    }

    fn step(&mut self) -> String {
        match self.chance.u8(0..14) {
            0 | 1 => self.go_to(),
            2 => {
                let ((axis, by), speed) = (self.displacement(), self.speed());
                format!("move_by(\"{}\", {by}, {speed});", self.axes[axis].name)
            }
            3 => {
                let ((axis, by), speed) = (self.displacement(), self.speed());
                format!("slew(\"{}\", {by}, {speed});", self.axes[axis].name)
            }
            4 | 5 => {
                let target = self.together(true);
                format!("line_to({target}, {});", self.speed())
            }
            6 => {
                let by = self.together(false);
                format!("line({by});")
            }
            7 => {
                let legs: Vec<_> = (0..self.chance.usize(2..6)).map(|_| self.together(true)).collect();
                format!("path_to([{}], {});", legs.join(", "), self.speed())
            }
            8 => {
                let axis = self.any_axis();
                self.axes[axis].at = Some(0);
                format!("origin(\"{}\");", self.axes[axis].name)
            }
            9 => {
                let axis = self.any_axis();
                self.axes[axis].at = Some(self.axes[axis].reference);
                format!("reference(\"{}\");", self.axes[axis].name)
            }
            10 => format!("wait(0.{:03});", self.chance.u16(1..500)),
            11 => {
                let (side, on) =
                    (self.chance.choice(["left", "right"]).unwrap_or("left"), self.chance.bool());
                format!("output(\"{side}_gripper\", {on});\nwait_for(\"{side}_grasped\", {on}, 2.0);")
            }
            12 => {
                let (one, other, line) = self.parts();
                format!("together {{\n    {one}\n    {other}\n    {line}\n}}")
            }
            _ => {
                let (one, other, line) = self.parts();
                format!("let begun = begin {{ {one} }};\n{other}\n{line}\nwait(begun);")
            }
        }
    }

    fn go_to(&mut self) -> String {
        let axis = self.any_axis();
        self.go(axis)
    }

    fn go(&mut self, axis: usize) -> String {
        let to = self.elsewhere(axis);
        let speed = if self.chance.bool() { format!(", {}", self.speed()) } else { String::new() };
        format!("go_to(\"{}\", {to}{speed});", self.axes[axis].name)
    }

    /// Two movements and a line, of different axes.
    fn parts(&mut self) -> (String, String, String) {
        let mut axes: Vec<usize> = (0..self.axes.len()).collect();
        self.chance.shuffle(&mut axes);
        let line: Vec<_> = axes[2..4].iter().map(|axis| (*axis, self.elsewhere(*axis))).collect();
        (self.go(axes[0]), self.go(axes[1]), format!("line_to({});", self.map(&line)))
    }

    /// A map with two to four axes: where they go, or by how much.
    fn together(&mut self, to: bool) -> String {
        let mut axes: Vec<usize> = (0..self.axes.len()).collect();
        self.chance.shuffle(&mut axes);
        axes.truncate(self.chance.usize(2..=4));
        let parts: Vec<_> = axes
            .into_iter()
            .map(|axis| {
                let from = self.axes[axis].at.unwrap_or_default();
                let target = self.elsewhere(axis);
                (axis, if to { target } else { target - from })
            })
            .collect();
        self.map(&parts)
    }

    fn map(&self, parts: &[(usize, i64)]) -> String {
        let parts: Vec<_> =
            parts.iter().map(|(axis, value)| format!("{}: {value}", self.axes[*axis].name)).collect();
        format!("#{{ {} }}", parts.join(", "))
    }

    fn displacement(&mut self) -> (usize, i64) {
        let axis = self.any_axis();
        let from = self.axes[axis].at.unwrap_or_default();
        (axis, self.elsewhere(axis) - from)
    }

    /// Another place for an axis; every fourth is very near, where movements are short.
    fn elsewhere(&mut self, axis: usize) -> i64 {
        let Axis { at, max, .. } = self.axes[axis];
        let from = at.unwrap_or_default();
        let near = self.chance.u8(0..4) == 0;
        let (low, high) = if near { ((from - 3).max(0), (from + 3).min(max)) } else { (0, max) };
        // One of the other places: whoever stands behind the gap moves up.
        let place = self.chance.i64(low..high);
        let to = if place >= from { place + 1 } else { place };
        self.axes[axis].at = Some(to);
        to
    }

    fn any_axis(&mut self) -> usize {
        self.chance.usize(0..self.axes.len())
    }

    /// Steps per second; programs with a long reach have no use for the slowest.
    fn speed(&mut self) -> u32 {
        let slowest = if self.reach > 10_000 { 4_000 } else { 700 };
        self.chance.u32(slowest..15_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_its_programs() {
        let texts = |seed| {
            let mut programmer = Programmer::new(seed, 5_000);
            [programmer.program(6).text, programmer.program(6).text]
        };
        assert_eq!(texts(7), texts(7));
        assert_ne!(texts(7), texts(8));
        let [first, second] = texts(7);
        assert!(first.starts_with("origin([") && !second.contains("origin(["), "{first}{second}");
    }
}
