//! The rotor: pulses and time in, angle and speed out. It knows no rail but its stops, and no firmware.
//!
//! Everything is reckoned from the detent that the rotor is in, and in the frame of the wanted field (φ = 0), so that no
//! number grows with the length of a movement. Between two pulses time goes in equal sub-steps that begin at the pulse,
//! with the rest before the next pulse as a shorter one. So the motion depends on the ticks of the pulses alone, and not on
//! how often somebody looked.
//!
//! A sub-step drifts for half of its time, changes the speed by the torque in its middle, and drifts on (second order,
//! conserves the energy of a swing). Damping is taken at the new speed, so that no friction, however large, can drive; dry
//! friction takes off at most the speed that there is, so that it can hold; the field decays exactly.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::ops::RangeInclusive;

use supersigma_config::{HALF_STEPS_PER_CYCLE, MotorConfig, MotorError};
use supersigma_protocol::{Direction, Tick, Ticks};

/// 20 µs and 5 µs.
const LONGEST_SUBSTEP: u8 = 40;
const SHORTEST_SUBSTEP: u8 = 10;
/// How far the rotor may swing in a sub-step, as natural angular frequency times duration.
const SWING_PER_SUBSTEP: f64 = 0.02;
/// A swing this small, in electrical radians, is rest.
const REST: f64 = 1e-4;
/// The field has arrived if it lacks no more than this part of itself, and to be sure of a capture the swing must lack this
/// part of the spring's largest energy.
const ARRIVED: f64 = 1e-3;
const DOUBT: f64 = 0.05;
/// Time in which any swing has faded: 10 s.
pub(crate) const PATIENCE: Ticks = Ticks(10 * Tick::PER_SECOND);
const CYCLE: i64 = HALF_STEPS_PER_CYCLE as i64;

#[expect(clippy::cast_precision_loss, reason = "2 000 000 is exact")]
const TICKS_PER_SECOND: f64 = Tick::PER_SECOND as f64;

/// A place in which the rotor can lock, in half steps from where it was switched on or, with
/// [stops](Rotor::with_stops), from wherever those are reckoned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Detent(pub i64);

/// Where the rotor is and how fast it turns.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Motion {
    /// Half steps, reckoned as [`Detent`] is.
    pub half_steps: f64,
    /// Half steps per second, positive if forward.
    pub speed: f64,
}

/// A rotor under way or at rest.
#[derive(Debug, Clone)]
pub struct Rotor {
    constants: Constants,
    stops: RangeInclusive<i64>,
    /// The detent of the wanted field.
    field: i64,
    /// The detent nearest to the rotor, among those of the wanted field: a whole number of cycles from it.
    well: i64,
    swing: Swing,
    /// Since the last whole sub-step.
    pending: u64,
    at_rest: bool,
    /// Cycles that the rotor has stayed behind the field for good; negative if it has got ahead.
    behind: i64,
    slips: u64,
}

/// What is integrated: electrical radians from the well, in the frame of the wanted field.
#[derive(Debug, Clone, Copy)]
struct Swing {
    angle: f64,
    /// Per second.
    speed: f64,
    /// z, the field that is; 1 + 0j when it has reached the wanted one.
    re: f64,
    im: f64,
}

/// All accelerations are electrical: p/J times a torque.
#[derive(Debug, Clone)]
struct Constants {
    substep: u64,
    /// e^(−t/2τ) for t of so many ticks.
    half_decay: [f64; LONGEST_SUBSTEP as usize + 1],
    /// 1/τ.
    field_rate: f64,
    spring: f64,
    load: f64,
    friction: f64,
    /// D/J and D₀/J.
    damping: f64,
    viscous: f64,
    /// s, electrical.
    slip: f64,
    /// The natural angular frequency.
    natural: f64,
}

impl Rotor {
    /// A rotor at rest in `detent`, with the field there.
    ///
    /// # Errors
    /// If such a motor cannot be.
    pub fn new(config: &MotorConfig, detent: Detent) -> Result<Self, MotorError> {
        config.check()?;
        Ok(Self {
            constants: Constants::new(config),
            stops: i64::MIN..=i64::MAX,
            field: detent.0,
            well: detent.0,
            swing: Swing { angle: 0.0, speed: 0.0, re: 1.0, im: 0.0 },
            pending: 0,
            at_rest: false,
            behind: 0,
            slips: 0,
        })
    }

    /// A rotor at rest with its load, which may hold it off the middle of detent 0.
    ///
    /// # Errors
    /// If such a motor cannot be.
    pub fn standing(config: &MotorConfig) -> Result<Self, MotorError> {
        let mut rotor = Self::new(config, Detent(0))?;
        rotor.settle(PATIENCE);
        Ok(rotor)
    }

    /// Between two stops that the rotor cannot pass; it hits them without bouncing.
    #[must_use]
    pub fn with_stops(mut self, lower: Detent, upper: Detent) -> Self {
        self.stops = lower.0..=upper.0;
        self
    }

    /// Turns the wanted field by one half step.
    pub fn pulse(&mut self, direction: Direction) {
        self.integrate_pending();
        let sense: i8 = match direction {
            Direction::Forward => 1,
            Direction::TowardsOrigin => -1,
        };
        self.field += i64::from(sense);
        self.well += i64::from(sense);
        let (sense, Swing { re, im, .. }) = (f64::from(sense), self.swing);
        self.swing.angle -= sense * FRAC_PI_4;
        // The field that is stays behind: in the new frame it is turned back by an eighth.
        self.swing.re = (re + sense * im) * FRAC_1_SQRT_2;
        self.swing.im = (im - sense * re) * FRAC_1_SQRT_2;
        self.at_rest = false;
        self.find_well();
    }

    /// Lets time pass. A rotor at rest costs nothing.
    pub fn advance(&mut self, span: Ticks) {
        self.pending += span.0;
        while self.pending >= self.constants.substep && !self.at_rest {
            self.pending -= self.constants.substep;
            self.integrate(self.constants.substep);
        }
        if self.at_rest {
            self.pending = 0;
        }
    }

    /// Where the rotor is now, and how fast.
    #[must_use]
    pub fn motion(&self) -> Motion {
        let now = if self.pending == 0 { self.swing } else { self.after(self.pending).0 };
        Motion { half_steps: whole(self.well) + now.angle / FRAC_PI_4, speed: now.speed / FRAC_PI_4 }
    }

    /// Where it would lock if it had no momentum: the detent of the field that is nearest to it.
    #[must_use]
    pub fn detent(&self) -> Detent {
        Detent(self.well)
    }

    /// Where it would lock if it had followed every pulse.
    #[must_use]
    pub fn field(&self) -> Detent {
        Detent(self.field)
    }

    /// Electrical cycles, eight half steps each, that the rotor has slipped by, backwards and forwards. One counts when the
    /// rotor is past the unstable point by another quarter of a cycle, where there is no way back.
    #[must_use]
    pub fn slips(&self) -> u64 {
        self.slips
    }

    /// Whether nothing moves, nor will before the next pulse.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.at_rest
    }

    /// Whether the rotor will come to rest in the [detent](Self::detent) that it is in, if no pulse comes: the field has
    /// arrived, and the swing has less energy than it takes to get over the nearer of the unstable points.
    ///
    /// ```text
    ///   U(θ) = −spring · cos θ + load · θ        the unstable points are at ±π + asin(load / spring)
    /// ```
    ///
    /// Long before it [is at rest](Self::is_at_rest) that is certain, because all the rest is friction. A slip may have been
    /// made by then and not yet been [counted](Self::slips); the detent knows of it.
    #[must_use]
    pub fn is_captured(&self) -> bool {
        let Swing { angle, speed, re, im } = self.swing;
        let Constants { spring, load, .. } = self.constants;
        let lean = (load.abs() / spring).asin();
        let barrier = spring * lean.cos() - load.abs() * (PI - lean);
        let energy = speed * speed / 2.0 - spring * angle.cos() + load * angle;
        let arrived = (re - 1.0).hypot(im) < ARRIVED;
        self.at_rest || arrived && angle.abs() < PI - lean && energy < barrier - DOUBT * spring
    }

    /// Lets time pass until the rotor [is captured](Self::is_captured), but `limit` at most; says whether it is.
    pub fn catch(&mut self, limit: Ticks) -> bool {
        let mut left = limit.0;
        while !self.is_captured() && left > 0 {
            let span = left.min(self.constants.substep);
            self.advance(Ticks(span));
            left -= span;
        }
        self.is_captured()
    }

    /// Gives pulses, one at the end of each period in ticks, until one of them finds that the rotor has slipped: its number,
    /// from 1.
    pub fn follow(&mut self, periods: impl IntoIterator<Item = u32>, direction: Direction) -> Option<u32> {
        (1..).zip(periods).find_map(|(pulse, period)| {
            self.advance(Ticks(period.into()));
            self.pulse(direction);
            (self.slips > 0).then_some(pulse)
        })
    }

    /// Whether it comes to rest, without a further pulse, where the pulses have led it; says so as soon as that is certain.
    pub fn arrives(&mut self) -> bool {
        self.catch(PATIENCE) && self.is_in_place()
    }

    /// Whether it is in the detent to which the pulses have led, and was never out of step on the way.
    #[must_use]
    pub fn is_in_place(&self) -> bool {
        self.slips == 0 && self.detent() == self.field()
    }

    /// Lets time pass until the rotor is at rest, but `limit` at most; says whether it is.
    pub fn settle(&mut self, limit: Ticks) -> bool {
        let mut left = limit.0;
        while !self.at_rest && left > 0 {
            let span = left.min(self.constants.substep);
            self.advance(Ticks(span));
            left -= span;
        }
        self.at_rest
    }

    fn integrate_pending(&mut self) {
        let pending = std::mem::take(&mut self.pending);
        if pending > 0 {
            self.integrate(pending);
        }
    }

    /// One sub-step of `ticks`, and what follows from it.
    fn integrate(&mut self, ticks: u64) {
        let stood = self.swing.speed == 0.0;
        let (swing, net) = self.after(ticks);
        self.swing = swing;
        self.find_well();
        self.find_rest(stood, net);
    }

    /// The swing after a sub-step of `ticks`, and the net acceleration but for dry friction.
    fn after(&self, ticks: u64) -> (Swing, f64) {
        let (mut swing, net) = self.constants.substep(self.swing, ticks);
        let position = whole(self.well) + swing.angle / FRAC_PI_4;
        for (stop, outward) in [(*self.stops.start(), -1.0), (*self.stops.end(), 1.0)] {
            if (position - whole(stop)) * outward > 0.0 {
                swing.angle = whole(stop.saturating_sub(self.well)) * FRAC_PI_4;
                swing.speed = 0.0;
            }
        }
        (swing, net)
    }

    /// Keeps the angle within half a cycle of the well, and counts slips.
    fn find_well(&mut self) {
        while self.swing.angle > PI {
            self.swing.angle -= TAU;
            self.well += CYCLE;
        }
        while self.swing.angle < -PI {
            self.swing.angle += TAU;
            self.well -= CYCLE;
        }
        let new = (self.field - self.well) / CYCLE - self.behind;
        if (new > 0 && self.swing.angle < FRAC_PI_2) || (new < 0 && self.swing.angle > -FRAC_PI_2) {
            self.behind += new;
            self.slips += new.unsigned_abs();
        }
    }

    /// `stood`: whether the speed was 0 before the sub-step; `net`: the acceleration in it.
    fn find_rest(&mut self, stood: bool, net: f64) {
        let Swing { angle, speed, re, im } = self.swing;
        if (re - 1.0).abs() > REST || im.abs() > REST {
            return;
        }
        let constants = &self.constants;
        // At a turning point the speed may be 0 once, but only what is held stands still.
        let held = stood && speed == 0.0;
        // What dry friction does not hold, and what the last swings leave of a motor without it.
        let faded = speed.abs() <= constants.natural * REST
            && net.abs() <= constants.friction + constants.spring * REST
            && angle.abs() < FRAC_PI_2;
        if held || faded {
            self.swing = Swing { angle, speed: 0.0, re: 1.0, im: 0.0 };
            self.at_rest = true;
        }
    }
}

impl Constants {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to 10 to 40 before the cast"
    )]
    fn new(config: &MotorConfig) -> Self {
        let cycles = f64::from(config.cycles_per_turn());
        let inertia = config.inertia();
        let per_torque = cycles / inertia;
        let natural = config.natural_hertz() * TAU;
        let wanted = SWING_PER_SUBSTEP / natural * TICKS_PER_SECOND;
        let field_rate = FRAC_PI_4 * config.corner_speed;
        let mut half_decay = [0.0; LONGEST_SUBSTEP as usize + 1];
        for (ticks, decay) in (0_u32..).zip(&mut half_decay) {
            *decay = (-field_rate * f64::from(ticks) / TICKS_PER_SECOND / 2.0).exp();
        }
        Self {
            substep: wanted.clamp(SHORTEST_SUBSTEP.into(), LONGEST_SUBSTEP.into()) as u64,
            half_decay,
            field_rate,
            spring: per_torque * config.holding_torque,
            load: per_torque * config.load_torque,
            friction: per_torque * config.friction,
            damping: config.damping / inertia,
            viscous: config.viscous_friction / inertia,
            slip: config.damping_slip * FRAC_PI_4,
            natural,
        }
    }

    /// The swing `ticks` later, and the net acceleration but for dry friction. `ticks` is at most the sub-step.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "a sub-step has at most 40 ticks"
    )]
    fn substep(&self, swing: Swing, ticks: u64) -> (Swing, f64) {
        let duration = ticks as f64 / TICKS_PER_SECOND;
        let decay = self.half_decay[ticks as usize];
        let angle = swing.angle + swing.speed * duration / 2.0;
        let (re, im) = (1.0 + (swing.re - 1.0) * decay, swing.im * decay);

        let (sine, cosine) = angle.sin_cos();
        let spring = self.spring * (im * cosine - re * sine);
        // |z|² ω = Im(z' z*) = −Im z / τ, so the damping needs no division by the field.
        let strength = re * re + im * im;
        let drag_speed = -im * self.field_rate;
        let slip = (strength * swing.speed - drag_speed) / (strength.max(1e-9) * self.slip);
        let damping = self.damping / (1.0 + slip * slip);

        let driving = spring - self.load + damping * drag_speed;
        let braking = self.viscous + damping * strength;
        let free = (swing.speed + duration * driving) / (1.0 + duration * braking);
        let speed = free.signum() * (free.abs() - duration * self.friction).max(0.0);
        let next = Swing {
            angle: angle + speed * duration / 2.0,
            speed,
            re: 1.0 + (re - 1.0) * decay,
            im: im * decay,
        };
        (next, driving - braking * swing.speed)
    }
}

/// Detents are far below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "see above; stops that are not there may round")]
fn whole(half_steps: i64) -> f64 {
    half_steps as f64
}
