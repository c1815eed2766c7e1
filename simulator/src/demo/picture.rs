//! The picture of the demo: ballbar traces, diagonals and recorded motion, without and with compensation.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Vermillion and blue: distinguishable for colour-blind readers and in grey.
const BEFORE: RGBColor = RGBColor(213, 94, 0);
const AFTER: RGBColor = RGBColor(0, 114, 178);
const INK: RGBColor = RGBColor(60, 60, 60);
const FAINT: RGBColor = RGBColor(200, 200, 200);
/// Size of a panel, px: the picture is shown at about this size, so type is read at the size it is set.
const PANEL: (u32, u32) = (340, 340);
/// Height of titles and of the legend, px.
const TITLE: u32 = 34;
const LEGEND: u32 = 34;
const FONT: &str = "sans-serif";

/// One curve without and one with compensation.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Curves {
    /// Points without compensation; a NaN is a gap.
    pub before: Vec<(f64, f64)>,
    /// Points with compensation.
    pub after: Vec<(f64, f64)>,
}

/// Everything that is drawn.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Picture {
    /// Title of the circle panel.
    pub circle_title: String,
    /// (angle in rad, radial deviation in um).
    pub circle: Curves,
    /// (distance along the diagonal in mm, deviation in um).
    pub diagonal: Curves,
    /// (time in s, size of the deviation of the tool tip in um).
    pub real_motion: Curves,
}

type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

impl Picture {
    /// The picture as SVG text.
    ///
    /// # Errors
    /// The drawing library could not draw it.
    pub fn svg(&self) -> Result<String, Box<dyn std::error::Error>> {
        let mut text = String::new();
        {
            let size = (3 * PANEL.0, TITLE + PANEL.1 + LEGEND);
            let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
            root.fill(&WHITE)?;
            let (titles, below) = root.split_vertically(TITLE);
            let (panels, legend) = below.split_vertically(PANEL.1);
            let heads =
                [&self.circle_title, "Body diagonal, worst of four", "Recorded motion of a part program"];
            for (area, head) in titles.split_evenly((1, 3)).iter().zip(heads) {
                area.titled(head, (FONT, 18).into_font().color(&INK))?;
            }
            let panels = panels.split_evenly((1, 3));
            let ring_um = self.draw_circle(&panels[0])?;
            draw_lines(&panels[1], ["distance along the diagonal / mm", "deviation / µm"], &self.diagonal)?;
            draw_lines(
                &panels[2],
                ["time / s (gap: break in the record)", "deviation of the tool tip / µm"],
                &self.real_motion,
            )?;
            draw_legend(&legend, ring_um)?;
            root.present()?;
        }
        Ok(text)
    }

    /// Polar: the nominal circle is a ring, deviations are drawn outwards and inwards, magnified. Returns the step between
    /// two rings, um.
    fn draw_circle(&self, panel: &Panel<'_>) -> Result<f64, Box<dyn std::error::Error>> {
        let largest =
            self.circle.before.iter().chain(&self.circle.after).fold(1.0f64, |m, p| m.max(p.1.abs()));
        let ring_step = nice_step(largest);
        let rings = (largest / ring_step).ceil().max(1.0);
        // the ring of deviation zero lies at 1, the largest deviation reaches 0.55 inwards or outwards
        let per_um = 0.55 / (rings * ring_step);
        let reach = 1.75;
        let (width, height) = panel.dim_in_pixel();
        // one unit must be as wide as it is high, or a circle would be drawn as an ellipse
        let wide = reach * f64::from(width) / f64::from(height);
        let mut chart = ChartBuilder::on(panel).build_cartesian_2d(-wide..wide, -reach..reach)?;
        let px_per_unit = f64::from(height) / (2.0 * reach);
        let count = rings as i32;
        for k in -count..=count {
            let radius = 1.0 + f64::from(k) * ring_step * per_um;
            let ring = (radius * px_per_unit).round() as i32;
            chart.draw_series([Circle::new((0.0, 0.0), ring, FAINT.stroke_width(1))])?;
        }
        // the outermost and the innermost ring enclose the traces: labels outside and inside of them cover nothing
        for (k, pos) in [(rings, VPos::Bottom), (-rings, VPos::Top)] {
            let label = format!("{}{} µm", if k > 0.0 { "+" } else { "" }, tick(k * ring_step));
            let style = (FONT, 15).into_font().color(&INK).pos(Pos::new(HPos::Center, pos));
            let gap = if k > 0.0 { 0.02 } else { -0.02 };
            chart.draw_series([Text::new(label, (0.0, 1.0 + k * ring_step * per_um + gap), style)])?;
        }
        for (points, colour) in [(&self.circle.before, BEFORE), (&self.circle.after, AFTER)] {
            let line = points.iter().map(|(angle, deviation)| {
                let r = 1.0 + deviation * per_um;
                (r * angle.cos(), r * angle.sin())
            });
            chart.draw_series(LineSeries::new(line, colour.stroke_width(3)))?;
        }
        // last: the compensated trace would hide it
        chart.draw_series([Circle::new((0.0, 0.0), px_per_unit.round() as i32, BLACK.stroke_width(1))])?;
        Ok(ring_step)
    }
}

fn draw_lines(panel: &Panel<'_>, [x_label, y_label]: [&str; 2], curves: &Curves) -> Drawn {
    let points = || curves.before.iter().chain(&curves.after).filter(|p| p.1.is_finite());
    if points().next().is_none() {
        // the library's mesh does not end on axes without extent
        return Ok(());
    }
    let range = |values: &dyn Fn(&(f64, f64)) -> f64| {
        let (low, high) =
            points().map(values).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low < high { (low, high) } else { (low.min(0.0), low.max(0.0) + 1.0) }
    };
    let (x_low, x_high) = range(&|p| p.0);
    let (y_low, y_high) = range(&|p| p.1);
    let room = 0.08 * (y_high - y_low.min(0.0));
    let y_bottom = if y_low >= 0.0 { 0.0 } else { y_low - room };
    let mut chart = ChartBuilder::on(panel)
        .margin(8)
        .margin_right(18)
        .x_label_area_size(44)
        .y_label_area_size(52)
        .build_cartesian_2d(x_low..x_high, y_bottom..y_high + room)?;
    chart
        .configure_mesh()
        .x_desc(x_label)
        .y_desc(y_label)
        .x_labels(6)
        .x_label_formatter(&|v| tick(*v))
        .y_label_formatter(&|v| tick(*v))
        .axis_desc_style((FONT, 16))
        .label_style((FONT, 15))
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT)
        .axis_style(INK)
        .draw()?;
    for (points, colour) in [(&curves.before, BEFORE), (&curves.after, AFTER)] {
        // a pause in the record is a gap in the line
        for stretch in points.split(|p| p.1.is_nan()) {
            chart.draw_series(LineSeries::new(stretch.iter().copied(), colour.stroke_width(2)))?;
        }
    }
    Ok(())
}

/// One legend for all panels; `ring_um` is the step of the rings of the first.
fn draw_legend(area: &Panel<'_>, ring_um: f64) -> Drawn {
    let y = LEGEND as i32 / 2;
    let circle = format!("nominal circle; one ring is {} µm", tick(ring_um));
    let entries = [
        (150, BEFORE.stroke_width(3), "without compensation"),
        (365, AFTER.stroke_width(3), "with volcomp"),
        (540, BLACK.stroke_width(1), &circle),
    ];
    for (x, style, label) in entries {
        area.draw(&PathElement::new(vec![(x, y), (x + 26, y)], style))?;
        area.draw(&Text::new(label, (x + 34, y - 8), (FONT, 16).into_font().color(&INK)))?;
    }
    Ok(())
}

/// A round figure without needless decimals.
fn tick(v: f64) -> String {
    let text = format!("{v:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A step of 1, 2 or 5 times a power of ten that puts two to four rings below `largest`.
fn nice_step(largest: f64) -> f64 {
    let rough = largest / 3.0;
    let power = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_few() {
        for (largest, step) in [(1.0, 0.5), (17.0, 10.0), (5.9, 2.0), (30.0, 10.0), (0.03, 0.01)] {
            assert!((nice_step(largest) - step).abs() < 1e-12, "{largest}: {}", nice_step(largest));
        }
    }

    #[test]
    fn the_picture_shows_both_traces_of_every_panel() {
        let curves = Curves {
            before: (0..90).map(|i| (f64::from(i) * 0.07, 20.0 * (f64::from(i) * 0.14).sin())).collect(),
            after: (0..90).map(|i| (f64::from(i) * 0.07, 1.0)).collect(),
        };
        let picture = Picture {
            circle_title: "Ballbar".into(),
            circle: curves.clone(),
            diagonal: curves.clone(),
            real_motion: curves,
        };
        let svg = picture.svg().unwrap();
        assert!(svg.starts_with("<svg"));
        let lines = |colour: &str| svg.matches("<polyline").count().min(svg.matches(colour).count());
        assert!(lines("#D55E00") >= 3 && lines("#0072B2") >= 3);
        // rings are circles, and only the two that enclose the traces carry a label
        assert!(svg.matches("<circle").count() >= 5);
        assert!(svg.matches("without compensation").count() == 1, "one legend");
        let nominal = svg.rfind("<circle").unwrap();
        assert!(svg[..nominal].contains("#0072B2"), "the nominal circle lies over the compensated trace");
        assert!(!svg.contains(".0\n") && svg.contains("\n2\n"), "ticks without needless decimals");
        assert!(svg.contains("+20 µm") && svg.contains("-20 µm") && !svg.contains("+0"), "{svg}");
    }

    #[test]
    fn empty_curves_are_drawn_as_empty_axes() {
        assert!(Picture::default().svg().is_ok());
    }
}
