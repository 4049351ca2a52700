//! What the bench's filters let through, over frequency.

use std::f64::consts::TAU;

use axis_worker::bench::Sampling;

use super::{BenchPlotError, WIDTH};
use crate::bench::filter::{Cutoff, Differentiator, LowPass, Taps};
use crate::plot::sheet::{
    Area, Drawn, Entry, Frame, GREY, Head, Words, dashes, nth_color, number, picture, polyline, px, stroke,
};
use crate::plot::{Picture, Size};

/// What the frame of the derivative filters has room for: 21 taps at 40 kHz have 2.5.
const TOP: f64 = 3.0;

/// Draws the gain of derivative filters of these lengths, and of low passes of these cutoffs, for one sampling frequency.
///
/// # Errors
/// If one of them cannot be made.
pub fn filters(sampling: Sampling, taps: &[Taps], cutoffs: &[Cutoff]) -> Result<Picture, BenchPlotError> {
    let derivatives = taps.iter().map(|&taps| Differentiator::new(taps, sampling));
    let derivatives = derivatives.collect::<Result<Vec<_>, _>>()?;
    let low_passes = cutoffs.iter().map(|&cutoff| LowPass::new(cutoff, sampling));
    let low_passes = low_passes.collect::<Result<Vec<_>, _>>()?;
    let names = taps.iter().map(|taps| format!("derivative filter, {} taps", taps.get()));
    let names = names.chain(cutoffs.iter().map(|cutoff| format!("low pass, {} Hz", cutoff.hertz())));
    let legend = names.enumerate().map(|(n, name)| Entry::line(name, nth_color(n))).collect();
    let title = "The filters of the test bench";
    let subtitle = format!("at {} samples/s", number(sampling.hertz().into(), 0));
    let head = Head { title, subtitle: &subtitle, legend };
    let pass = Differentiator::PASS_HERTZ;
    let draw = |root: &Area<'_>| -> Drawn {
        head.draw(root, WIDTH)?;
        let (_, rest) = root.split_vertically(px(head.height(WIDTH)));
        let (above, below) = rest.split_vertically(px(290.0));
        let heading = "Derivative filters: gain, of what a derivative has at 1 kHz";
        let end = (f64::from(sampling.hertz()) / 2.0).min(12.0 * pass);
        let frame =
            Frame { heading, x: 0.0..end, y: 0.0..TOP, x_name: Some("frequency, Hz"), y_name: Some("gain") };
        let chart = frame.draw(&above)?;
        dashes(&chart, (pass, 0.0), (pass, TOP), &GREY, 4.0)?;
        Words::new(12.0).color(GREY).below().mark(&chart, (pass, TOP), (6.0, 5.0), "pass band up to here")?;
        polyline(&chart, vec![(0.0, 0.0), (0.95 * TOP * pass, 0.95 * TOP)], stroke(&GREY, 1.0))?;
        Words::new(12.0).color(GREY).mark(
            &chart,
            (0.95 * TOP * pass, 0.95 * TOP),
            (6.0, 0.0),
            "a derivative",
        )?;
        for (n, filter) in derivatives.iter().enumerate() {
            let curve = curve(end, |hertz| filter.response(hertz).gain / (TAU * pass));
            polyline(&chart, curve, stroke(&nth_color(n), 1.75))?;
        }
        let heading = "Low passes: gain; at the cutoff half of the power is left";
        let frame = Frame { heading, x: 0.0..1.5 * pass, y: 0.0..1.08, ..frame };
        let chart = frame.draw(&below)?;
        let half = std::f64::consts::FRAC_1_SQRT_2;
        dashes(&chart, (0.0, half), (frame.x.end, half), &GREY, 4.0)?;
        Words::new(12.0).color(GREY).ends().above().mark(
            &chart,
            (frame.x.end, half),
            (-6.0, -3.0),
            "1/√2",
        )?;
        for (n, filter) in low_passes.iter().enumerate() {
            let curve = curve(frame.x.end, |hertz| filter.response(hertz).gain);
            polyline(&chart, curve, stroke(&nth_color(derivatives.len() + n), 1.75))?;
        }
        Ok(())
    };
    Ok(picture(Size { width: WIDTH, height: 640 }, title, draw)?)
}

fn curve(end: f64, gain: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    (0..=600).map(|part| end * f64::from(part) / 600.0).map(|hertz| (hertz, gain(hertz))).collect()
}
