//! The incremental encoder on the shaft, and the logic that makes counts of its two signals (\[M\], Fig. 1 and 2). The
//! discriminator knows only levels, not angles: it can be wrong where the real one can.
//!
//! ```text
//!            clockwise, angles grow →
//!        ┌───────┐       ┌───────┐
//!  A ────┘       └───────┘       └───      L: one pulse at each edge of A or B while turning clockwise
//!            ┌───────┐       ┌───────┐     R: one at each edge while turning anticlockwise
//!  B ────────┘       └───────┘       └
//!    0   1   2   3   0   1   2   3   0     four counts to a line
//! ```

use std::iter::FusedIterator;

use supersigma_config::MotorConfig;

/// A number of counts, four to a line of the disc; positive is clockwise, which is forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Counts(pub i64);

/// Both signals at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Levels {
    /// The leading one, when turning clockwise.
    pub a: bool,
    /// The other.
    pub b: bool,
}

impl Levels {
    fn of(count: i64) -> Self {
        let quarter = count.rem_euclid(4);
        Self { a: matches!(quarter, 1 | 2), b: matches!(quarter, 2 | 3) }
    }

    /// The count within a line.
    fn quarter(self) -> u8 {
        match (self.a, self.b) {
            (false, false) => 0,
            (true, false) => 1,
            (true, true) => 2,
            (false, true) => 3,
        }
    }
}

/// A disc on a shaft.
#[derive(Debug, Clone)]
pub struct Encoder {
    counts_per_half_step: f64,
    count: i64,
}

impl Encoder {
    /// The encoder of `config`, with the shaft at `half_steps`.
    #[must_use]
    pub fn new(config: &MotorConfig, half_steps: f64) -> Self {
        let per_turn = 4.0 * f64::from(config.encoder_lines);
        let counts_per_half_step = per_turn / f64::from(config.half_steps_per_turn);
        let mut encoder = Self { counts_per_half_step, count: 0 };
        encoder.count = encoder.count_at(half_steps);
        encoder
    }

    /// The two signals now.
    #[must_use]
    pub fn levels(&self) -> Levels {
        Levels::of(self.count)
    }

    /// The shaft turns to `half_steps`; gives the signals after each edge on the way, as a discriminator sees them that
    /// misses none.
    pub fn turn_to(&mut self, half_steps: f64) -> Passed {
        let from = self.count;
        self.count = self.count_at(half_steps);
        Passed { at: from, to: self.count }
    }

    /// How far `counts` are, in half steps.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
    pub fn half_steps(&self, counts: Counts) -> f64 {
        counts.0 as f64 / self.counts_per_half_step
    }

    /// A detent lies in the middle of a count, so that a rotor in it does not chatter.
    #[expect(clippy::cast_possible_truncation, reason = "counts are far below 2⁵³")]
    fn count_at(&self, half_steps: f64) -> i64 {
        (half_steps * self.counts_per_half_step).round() as i64
    }
}

/// The signals after each edge of a turn.
#[derive(Debug, Clone)]
pub struct Passed {
    at: i64,
    to: i64,
}

impl Passed {
    /// How many edges are still to come.
    #[must_use]
    pub fn edges(&self) -> u64 {
        self.to.abs_diff(self.at)
    }
}

impl Iterator for Passed {
    type Item = Levels;

    fn next(&mut self) -> Option<Levels> {
        if self.at == self.to {
            return None;
        }
        self.at += (self.to - self.at).signum();
        Some(Levels::of(self.at))
    }
}

impl FusedIterator for Passed {}

/// What one pair of levels after another can say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sense {
    /// A pulse on L.
    Clockwise,
    /// A pulse on R.
    Anticlockwise,
}

/// The SENSE DISCRIMINATOR of \[M\], with the counters that it feeds: four counts to a line.
#[derive(Debug, Clone)]
pub struct SenseDiscriminator {
    last: Levels,
    last_sense: Option<Sense>,
    clockwise: u64,
    anticlockwise: u64,
    reversals: u64,
    illegal: u64,
}

impl SenseDiscriminator {
    /// With all counters at 0 and the signals at `levels`.
    #[must_use]
    pub fn new(levels: Levels) -> Self {
        Self { last: levels, last_sense: None, clockwise: 0, anticlockwise: 0, reversals: 0, illegal: 0 }
    }

    /// Takes the next sample of both signals. If both have changed, an edge was missed: that says nothing about the
    /// sense, counts as illegal, and the position is wrong by two counts from then on.
    pub fn sample(&mut self, levels: Levels) -> Option<Sense> {
        let turned = (levels.quarter() + 4 - self.last.quarter()) % 4;
        self.last = levels;
        let sense = match turned {
            1 => Sense::Clockwise,
            3 => Sense::Anticlockwise,
            2 => {
                self.illegal += 1;
                return None;
            }
            _ => return None,
        };
        match sense {
            Sense::Clockwise => self.clockwise += 1,
            Sense::Anticlockwise => self.anticlockwise += 1,
        }
        if self.last_sense.is_some_and(|last| last != sense) {
            self.reversals += 1;
        }
        self.last_sense = Some(sense);
        Some(sense)
    }

    /// Pulses on L.
    #[must_use]
    pub fn clockwise(&self) -> u64 {
        self.clockwise
    }

    /// Pulses on R.
    #[must_use]
    pub fn anticlockwise(&self) -> u64 {
        self.anticlockwise
    }

    /// L pulses less R pulses: how far the shaft has turned since the beginning.
    #[must_use]
    pub fn position(&self) -> Counts {
        Counts(self.clockwise.cast_signed() - self.anticlockwise.cast_signed())
    }

    /// How often the sense changed.
    #[must_use]
    pub fn reversals(&self) -> u64 {
        self.reversals
    }

    /// How often both signals had changed.
    #[must_use]
    pub fn illegal(&self) -> u64 {
        self.illegal
    }
}
