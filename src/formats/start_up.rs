//! Start-up outliers of a positioning test in the units of a report, with the figures of the test without them.

use super::positioning_test::PositioningTest;
use crate::prelude::*;
use volcomp_evaluate::{Positioning, PositioningReading};
use volcomp_identify::start_up::{StartUpOutlier, start_up_outliers};

/// A start-up outlier in the units of the report: mm or deg, um or arcsec.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Marked {
    /// Line in the file.
    pub line: u64,
    /// The target.
    pub target: f64,
    /// Direction of approach.
    pub travel: Travel,
    /// The cycle.
    pub cycle: u32,
    /// The deviation.
    pub deviation: f64,
    /// Deviation minus the median of the other cycles at the same target and direction.
    pub apart: f64,
    /// Limit of `apart`.
    pub limit: f64,
}

/// The start-up outliers of a test and the figures without them.
#[derive(Debug, Clone)]
pub struct StartUp {
    /// The outliers.
    pub marked: Vec<Marked>,
    /// `None` where too few readings are left at a target.
    pub without: Option<Positioning>,
}

impl StartUp {
    /// `None` for a test without start-up outliers.
    #[must_use]
    pub fn of(test: &PositioningTest) -> Option<Self> {
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
#[must_use]
pub fn in_report_units(kind: AxisKind, r: &Reading) -> PositioningReading {
    let (target, deviation) = (kind.position_out(r.position), kind.offset_out(r.value));
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
