//! Start-up outliers of a positioning test in words: by line, with the figures of the test with and without them.

use volcomp_evaluate::{Positioning, PositioningReading};
use volcomp_formats::positioning_test::PositioningTest;
use volcomp_identify::Reading;
use volcomp_identify::start_up::{StartUpOutlier, start_up_outliers};
use volcomp_units::axes::{AxisKind, Travel};
use volcomp_units::{arcsec_from_rad, deg_from_rad, um_from_mm};

/// A start-up outlier in the units of the report: mm or deg, um or arcsec.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Marked {
    /// Line in the file.
    pub(crate) line: u64,
    /// The target.
    pub(crate) target: f64,
    /// Direction of approach.
    pub(crate) travel: Travel,
    /// The cycle.
    pub(crate) cycle: u32,
    /// The deviation.
    pub(crate) deviation: f64,
    /// Deviation minus the median of the other cycles at the same target and direction.
    pub(crate) apart: f64,
    /// Limit of `apart`.
    pub(crate) limit: f64,
}

/// The start-up outliers of a test and the figures without them.
#[derive(Debug, Clone)]
pub(crate) struct StartUp {
    pub(crate) marked: Vec<Marked>,
    /// `None` where too few readings are left at a target.
    pub(crate) without: Option<Positioning>,
}

impl StartUp {
    /// `None` for a test without start-up outliers.
    pub(crate) fn of(test: &PositioningTest) -> Option<Self> {
        let found = start_up_outliers(&test.readings);
        if found.is_empty() {
            return None;
        }
        let is_marked = |i: usize| found.iter().any(|o| o.reading == i);
        let rest: Vec<PositioningReading> = (0..test.readings.len())
            .filter(|i| !is_marked(*i))
            .map(|i| in_report_units(test.kind, &test.readings[i]))
            .collect();
        let marked = found.iter().map(|o| marked(test, o)).collect();
        Some(Self { marked, without: Positioning::evaluate(&rest).ok() })
    }
}

/// A reading in mm and um, or deg and arcsec.
pub(crate) fn in_report_units(kind: AxisKind, r: &Reading) -> PositioningReading {
    let (target, deviation) = match kind {
        AxisKind::Linear => (r.position, um_from_mm(r.value)),
        AxisKind::Rotary => (deg_from_rad(r.position), arcsec_from_rad(r.value)),
    };
    PositioningReading { travel: r.travel, target, deviation }
}

fn marked(test: &PositioningTest, o: &StartUpOutlier) -> Marked {
    let r = &test.readings[o.reading];
    let at = in_report_units(test.kind, r);
    let scale = |v: f64| in_report_units(test.kind, &Reading { value: v, ..*r }).deviation;
    Marked {
        line: test.line(o.reading),
        target: at.target,
        travel: r.travel,
        cycle: r.cycle,
        deviation: at.deviation,
        apart: scale(o.apart),
        limit: scale(o.limit),
    }
}

/// Units of targets and deviations.
pub(crate) const fn units(kind: AxisKind) -> (&'static str, &'static str) {
    match kind {
        AxisKind::Linear => ("mm", "µm"),
        AxisKind::Rotary => ("deg", "arcsec"),
    }
}

impl Marked {
    /// `start-up outlier at 15 mm forward, cycle 1: 93.2 µm, +114.4 µm from the median of the other cycles (limit 6.1 µm)`.
    pub(crate) fn words(&self, kind: AxisKind) -> String {
        let (length, unit) = units(kind);
        let way = if self.travel == Travel::Reverse { "backward" } else { "forward" };
        format!(
            "start-up outlier at {} {length} {way}, cycle {}: {:.1} {unit}, {:+.1} {unit} from the median of the other cycles \
             (limit {:.1} {unit})",
            (self.target * 1e6).round() / 1e6,
            self.cycle,
            self.deviation,
            self.apart,
            self.limit
        )
    }
}

/// Reports the start-up outliers of a file on stderr.
pub(crate) fn report(file: &str, test: &PositioningTest) {
    let Some(start_up) = StartUp::of(test) else { return };
    for m in &start_up.marked {
        note!("warning: {file}:{}: {}", m.line, m.words(test.kind));
    }
    let all: Vec<PositioningReading> = test.readings.iter().map(|r| in_report_units(test.kind, r)).collect();
    let accuracy = |p: &Positioning| p.both.map(|b| b.a).or(p.forward.or(p.backward).map(|d| d.a));
    let (_, unit) = units(test.kind);
    let with = Positioning::evaluate(&all).ok().as_ref().and_then(accuracy);
    if let (Some(with), Some(without)) = (with, start_up.without.as_ref().and_then(accuracy)) {
        note!(
            "  kept; accuracy A {with:.1} {unit} with them, {without:.1} {unit} without; repeat the test after a warm-up"
        );
    }
}
