//! A stepping motor that can lose steps, and the encoder that finds it out. This is physics, in `f64`: what the pulses do
//! to a rotor. No firmware knows of it, and no pulse depends on it; the pulse path stays in integers.
//!
//! # The rotor
//!
//! Each pulse turns the stator's field by one half step, an eighth of an electrical cycle. The rotor follows as if
//! held by a spring that gives way: up to a quarter of a cycle (2 half steps) the torque grows with the lag, at half a
//! cycle it is zero and beyond it pulls to the next detent, a whole cycle away. So a motor never loses one step, but
//! eight at a time.
//!
//! ```text
//!  torque                                            p  electrical cycles per turn
//!  forward │    ╭──╮                  ╭──╮           ε  electrical angle of the rotor, p θ
//!          │  ╱      ╲              ╱      ╲         φ  that of the field wanted: π/4 per pulse
//!  ────────┼●──────────○──────────●──────────○─ lag  z  the field that is (complex, |z| ≤ 1)
//!          │            ╲        ╱                   T  holding torque
//!          │              ╲────╱                     J  inertia of rotor and load
//!           detent   unstable   next detent
//!           0        4          8 half steps
//! ```
//!
//! The windings' currents follow the wanted field with the time constant τ of their inductance, and the rotor the
//! currents:
//!
//! ```text
//! τ z' = e^(jφ) − z                                 τ = 4 / (π · corner speed)
//! J θ'' = T · Im(z e^(−jε))                         the spring
//!         − D · m / (1 + (m / (|z|² s))²)           the damping, m = |z|² (θ' − ω), ω the speed of z, s its best slip
//!         − D₀ θ' − F · sign θ' − load              friction and load
//! ```
//!
//! At a constant speed of `f` half steps/s, |z| settles to 1/√(1 + (f / corner)²): the torque rolls off by the motor's own
//! equation. The damping is that of a synchronous machine: it is strongest near synchronism, weak at a large slip (Kloss'
//! formula), and nothing when the rotor turns with the field, so that it costs no torque at speed.
//!
//! # The characteristic
//!
//! Two limits, \[M\]: a motor at rest follows a pulse train below *pull-in*; once running, and accelerated gently, it holds
//! up to *pull-out*. The ramp exists to cross what lies between. Below *start-stop*, the train may besides end after any
//! number of pulses.
//!
//! ```text
//!  torque of
//!  a brake
//!   2 N·m ┤ ╲   ╲                                  bench motor, no load inertia, half steps/s
//!         │  ╲     ╲
//!         │   ╲       ╲                            brake    start-stop  pull-in  pull-out
//!   1 N·m ┤    ╲         ╲                         none        1 400     2 450    35 000
//!         │     ╲           ╲      slips           0.5 N·m     1 650     2 050    14 800
//!         │starts╲    ramp     ╲                   1 N·m       1 600     1 600     8 100
//!         │       ╲   only        ╲                2 N·m         640       640     2 600
//!       0 ┼────────╲─────────────────╲── speed
//!                pull-in          pull-out
//! ```

mod encoder;
mod limits;
mod rotor;
#[cfg(test)]
mod tests;

pub use encoder::{Counts, Encoder, Levels, Passed, Sense, SenseDiscriminator};
pub use limits::{Characteristic, Load, characteristic, pull_in, pull_out, start_stop};
pub(crate) use rotor::PATIENCE;
pub use rotor::{Detent, Motion, Rotor};
