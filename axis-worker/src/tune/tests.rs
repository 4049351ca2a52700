//! Proposals against the rotor, and against each other.

use supersigma_config::{MotorConfig, RampConfig};
use supersigma_protocol::Distance;

use super::*;

fn distance(half_steps: u16) -> Distance {
    Distance::new(half_steps).expect("not zero")
}

#[test]
fn look() {
    for (torque, inertia, n) in [(0.0, 0.0, 4_000), (0.0, 1.2e-3, 4_000), (0.5, 0.0, 4_000),(0.0,0.0,600),(0.5,1.2e-3,200),(0.5,1.2e-3,20),(1.5,1.2e-3,2000)] {
        let motor = MotorConfig { friction: 0.03 + torque, load_inertia: inertia, ..MotorConfig::bench() };
        let margin = Margin::new(0.3).unwrap();
        let t = std::time::Instant::now();
        match linear(&motor, distance(n), margin) { Ok(p) => {
        println!("{n} {:?} trials {} {:?}", p.profile, p.trials, t.elapsed());
        println!("   {:?} {:?}", assess(&motor, margin, &p.pulses).unwrap(), t.elapsed());},
        Err(e) => println!("{e}") };
        let t = std::time::Instant::now();
        match sin2(&motor, distance(n), margin, &RampConfig::default()) { Ok(p)=> {
        println!("{n} {:?} trials {} {:?}", p.ramp, p.trials, t.elapsed());
        println!("   {:?} {:?}", assess(&motor, margin, &p.pulses).unwrap(), t.elapsed());},
        Err(e) => println!("{e}") };
    }
}
