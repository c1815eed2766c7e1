//! The picture of live estimation: sensors, how consistent they were over time, and the maps with their uncertainty.

use core::ops::Range;

use crate::report::plot::*;

use volcomp_daemon::{FilterStatus, MapStatus, NodeStatus, SensorStatus};
use volcomp_model::statistics::hull;

const PANEL: (u32, u32) = (900, 280);
/// Height of the legend below a panel: it never covers data.
const LEGEND: i32 = 26;
const COLOURS: [RGBColor; 4] = [BLUE, VERMILLION, RGBColor(0, 158, 115), RGBColor(204, 121, 167)];
/// Largest number that the panels over time show.
const TOP: f64 = 3.0;

/// Seconds and health, the newest last.
type Course = [(f64, FilterStatus)];

/// The sensors as they stand; where there is a course of time their innovations and acceptance over it; then the newest
/// maps, one panel per component: estimate over X with bars of one standard deviation, and what is used of it.
pub(super) fn picture(course: &Course) -> Svg {
    let newest = course.last().map(|(_, filter)| filter);
    let maps = newest.map_or(&[][..], |filter| &filter.maps[..]);
    let panels: Vec<(&MapStatus, usize)> =
        maps.iter().flat_map(|map| (0..map.components.len()).map(move |c| (map, c))).collect();
    let over_time: &[fn(&Area<'_>, &Course) -> Drawn] =
        if course.len() > 1 { &[consistency, innovations, acceptance] } else { &[] };
    let count = 1 + over_time.len() + panels.len();
    svg_of((PANEL.0, PANEL.1 * u32::try_from(count)?), |root| {
        let mut areas = root.split_evenly((count, 1)).into_iter();
        if let Some((area, filter)) = areas.next().zip(newest) {
            sensors(&area, &filter.sensors)?;
        }
        for (draw, area) in over_time.iter().zip(areas.by_ref()) {
            draw(&area, course)?;
        }
        panels.into_iter().zip(areas).try_for_each(|((map, c), area)| component(&area, map, c))
    })
}

/// How each sensor stands, in words.
fn sensors(area: &Area<'_>, sensors: &[SensorStatus]) -> Drawn {
    let style = ("sans-serif", 14).into_font().color(&INK);
    let words = |s: &SensorStatus| {
        let mut text = format!("{} {}", s.name, s.state);
        if let Some(cause) = &s.cause {
            text += &format!(": {cause}");
        }
        if let Some((innovation, expected)) = s.innovation.zip(s.innovation_expected) {
            text += &format!("; innovation {innovation:.2}, expected {expected:.2}");
        }
        if let Some(nis) = s.nis {
            text += &format!("; mean square over variance {nis:.2}");
        }
        text + &format!("; {} of {} readings used, {} beyond the gate", s.used, s.readings, s.rejected)
    };
    for (k, sensor) in sensors.iter().enumerate() {
        area.draw_text(&words(sensor), &style, (16, 16 + 20 * i32::try_from(k)?))?;
    }
    Ok(())
}

/// One component of a map over X.
fn component(area: &Area<'_>, map: &MapStatus, c: usize) -> Drawn {
    let xs = map.nodes.iter().map(|n| n.position_mm[0]);
    let [low, high] = hull(xs);
    let largest = map.nodes.iter().map(|n| n.value[c].abs() + n.std[c]).fold(1e-6, f64::max) * 1.1;
    let keys = [
        Key::line(BLUE, 2, "learned"),
        Key::line(BLUE.mix(0.4), 2, "one standard deviation either way"),
        Key::dot(VERMILLION, "what is used"),
    ];
    let area = &with_legend(area, &keys)?;
    let (map_name, name, unit, weight) = (&map.name, &map.components[c], &map.units[c], map.weight);
    let title =
        format!("{map_name}.{name} ({unit}), difference from the offline map; used with weight {weight:.2}");
    let ranges = [low..high.max(low + 1.0), -largest..largest];
    let mut chart = axes(area, [&title, "X in mm"], ranges)?;
    for line in lines(map) {
        let of = |values: fn(&NodeStatus) -> &Vec<f64>| {
            line.iter().map(|k| (map.nodes[*k].position_mm[0], values(&map.nodes[*k])[c])).collect::<Vec<_>>()
        };
        let (value, std, used) = (of(|n| &n.value), of(|n| &n.std), of(|n| &n.used));
        let bars = value.iter().zip(&std).map(|((x, v), (_, s))| vec![(*x, v - s), (*x, v + s)]);
        chart.draw_series(bars.map(|bar| PathElement::new(bar, BLUE.mix(0.4))))?;
        chart.draw_series(LineSeries::new(value, &BLUE))?;
        chart.draw_series(used.into_iter().map(|at| Circle::new(at, 2, VERMILLION.filled())))?;
    }
    Ok(())
}

/// Axes with a title above.
fn axes<'a, 'b>(area: &'a Area<'b>, words: [&str; 2], [x, y]: [Range<f64>; 2]) -> Drawn<Chart<'a, 'b>> {
    let [title, x_label] = words;
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 15, &INK))
        .margin(8)
        .x_label_area_size(24)
        .y_label_area_size(60)
        .build_cartesian_2d(x, y)?;
    chart.configure_mesh().x_desc(x_label).light_line_style(WHITE).draw()?;
    Ok(chart)
}

/// The area above a legend, which is drawn; none where there are no series.
fn with_legend<'a>(area: &Area<'a>, keys: &[Key]) -> Drawn<Area<'a>> {
    let height = i32::try_from(area.dim_in_pixel().1)?;
    let (chart, below) = area.split_vertically(height - LEGEND);
    if keys.is_empty() {
        below.draw_text("no readings yet", &("sans-serif", 14).into_font().color(&INK), (68, 2))?;
    }
    legend(&below, keys, 68, LEGEND / 2)?;
    Ok(chart)
}

/// Running mean of squared innovation over variance of each sensor over time: about 1 where everything is right.
fn consistency(area: &Area<'_>, course: &Course) -> Drawn {
    let title = "squared innovation over its variance, running mean: 1 is right";
    over_time(area, course, title, &[("", &|_, now| now.nis)])
}

/// RMS innovation of the readings and what is expected of it.
fn innovations(area: &Area<'_>, course: &Course) -> Drawn {
    let title = "RMS innovation of a reading, in learned standard deviations of the sensor";
    let curves: [(&str, Of<'_>); 2] =
        [("", &|_, now| now.innovation), (" expected", &|_, now| now.innovation_expected)];
    over_time(area, course, title, &curves)
}

/// Share of the readings since the entry before that were used.
fn acceptance(area: &Area<'_>, course: &Course) -> Drawn {
    let share = |before: Option<&SensorStatus>, now: &SensorStatus| {
        let before = before?;
        let came = now.readings.checked_sub(before.readings).filter(|came| *came > 0)?;
        Some(now.used.saturating_sub(before.used) as f64 / came as f64)
    };
    over_time(area, course, "readings used of those that came: 1 is all", &[("", &share)])
}

/// What a panel shows of a sensor: its entry before and the present one.
type Of<'a> = &'a dyn Fn(Option<&SensorStatus>, &SensorStatus) -> Option<f64>;

fn over_time(area: &Area<'_>, course: &Course, title: &str, curves: &[(&str, Of<'_>)]) -> Drawn {
    let (mut keys, mut drawn) = (Vec::new(), Vec::new());
    let names = course.last().map_or(&[][..], |(_, filter)| &filter.sensors[..]);
    for (k, name) in names.iter().map(|s| &s.name).enumerate() {
        let find = |filter: &'_ FilterStatus| filter.sensors.iter().position(|s| s.name == *name);
        for (c, (suffix, of)) in curves.iter().enumerate() {
            let mut before = None;
            let mut line = Vec::new();
            for (t, filter) in course {
                let now = find(filter).map(|k| &filter.sensors[k]);
                let value = now.and_then(|now| of(before, now));
                line.extend(value.map(|value| (*t, value.min(TOP))));
                before = now;
            }
            if line.is_empty() {
                continue;
            }
            let colour = COLOURS[k % COLOURS.len()].mix(if c == 0 { 1.0 } else { 0.4 });
            keys.push(Key::line(colour, 2, format!("{name}{suffix}")));
            drawn.push((line, colour));
        }
    }
    let area = &with_legend(area, &keys)?;
    let end = course.last().map_or(1.0, |(t, _)| t.max(1.0));
    let mut chart = axes(area, [title, "time in s"], [0.0..end, 0.0..TOP])?;
    for (line, colour) in drawn {
        chart.draw_series(LineSeries::new(line, &colour))?;
    }
    Ok(())
}

/// Nodes of equal Y and Z, by their numbers.
pub(super) fn lines(map: &MapStatus) -> Vec<Vec<usize>> {
    let mut lines: Vec<Vec<usize>> = Vec::new();
    for (k, node) in map.nodes.iter().enumerate() {
        let same = |line: &&mut Vec<usize>| {
            line.first().is_some_and(|first| map.nodes[*first].position_mm[1..] == node.position_mm[1..])
        };
        match lines.iter_mut().find(same) {
            Some(line) => line.push(k),
            None => lines.push(vec![k]),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(sensors: &[SensorStatus]) -> Vec<(f64, FilterStatus)> {
        let status = FilterStatus { sensors: sensors.to_vec(), ..FilterStatus::default() };
        vec![(0.0, status.clone()), (60.0, status)]
    }

    #[test]
    fn panels_without_series_have_no_empty_legend_box() {
        let svg = picture(&course(&[])).unwrap();
        // the background is the only box
        assert_eq!(svg.matches("<rect").count(), 1, "{svg}");
        assert_eq!(svg.matches("no readings yet").count(), 3);
    }

    #[test]
    fn the_legend_stands_below_its_panel() {
        let sensor = SensorStatus { name: "probe".to_owned(), nis: Some(1.0), ..SensorStatus::default() };
        let svg = picture(&course(&[sensor])).unwrap();
        let (before, _) = svg.split_once("\nprobe\n").unwrap();
        let line = before.rsplit("<text").next().unwrap();
        let y: f64 = line.split(" y=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap();
        let height = f64::from(PANEL.1);
        assert!(y > 2.0 * height - f64::from(LEGEND) && y < 2.0 * height, "{y}");
    }
}
