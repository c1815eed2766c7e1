//! `--through`: what the measurements of a machine under its control share.

use std::path::Path;

use volcomp_units::axes::AxisName;

use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_IOERR, EX_USAGE, Failure};
use crate::demo::programs::Programs;
use crate::through::{Local, Measured, Point, Remote, Want};

/// The control to measure through.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ThroughArgs {
    /// Measure the machine under its control, with the corrections of its daemon: the measuring port of a running
    /// `cncsim serve --measure`, or the daemon's machine file, from which control and daemon are then started.
    #[arg(long, value_name = "HOST:PORT|FILE")]
    through: Option<String>,
}

/// Dwell at each stop: drives and corrections settle, s.
pub(super) const DWELL_S: f64 = 0.25;
/// Feed between stops, mm/min.
const FEED: f64 = 10_000.0;

impl ThroughArgs {
    /// What was measured, for people.
    pub(super) fn how(&self, machine: &Path) -> String {
        match &self.through {
            Some(through) => format!("through the control of {through}"),
            None => format!("without compensation, machine {}", machine.display()),
        }
    }

    /// The machine under its control, where one was named. `machine` is the truth and `out` the folder for the log of a
    /// daemon that is started.
    pub(super) fn open(&self, machine: &Path, out: &Path) -> Result<Option<Box<dyn Measured>>, Failure> {
        let Some(through) = &self.through else {
            note!("{}; --through measures with it", self.how(machine));
            return Ok(None);
        };
        let io = |e: anyhow::Error| Failure::new(EX_IOERR, format_args!("--through {through}: {e:#}"));
        let file = Path::new(through);
        if !file.is_file() {
            return Ok(Some(Box::new(Remote::connect(through).map_err(io)?)));
        }
        crate::cli::make_folder(out).map_err(|e| Failure::in_file(EX_IOERR, out, e))?;
        let programs = Programs::this().map_err(io)?;
        let machine = built_in_or_file(machine)?;
        let log = out.join("volcompd.log");
        note!("starting control and daemon; log of the daemon: {}", log.display());
        Ok(Some(Box::new(Local::start(machine, &programs, file, &log).map_err(io)?)))
    }
}

/// Runs a part program on the machine; says where nothing was compensated.
pub(super) fn run(machine: &mut dyn Measured, program: &str, want: Want) -> Result<Vec<Point>, Failure> {
    let points = machine.run(program, want).map_err(|e| Failure::new(EX_IOERR, format_args!("{e:#}")))?;
    if points.is_empty() {
        return Err(Failure::new(EX_DATAERR, "the control has measured nothing"));
    }
    let with = points.iter().filter(|p| p.compensated).count();
    if with < points.len() {
        note!(
            "warning: the daemon compensated in full at {with} of {} readings only; its status or log says why",
            points.len()
        );
    }
    Ok(points)
}

/// Travel of an axis of the machine.
pub(super) fn travel(machine: &dyn Measured, axis: AxisName) -> Result<[f64; 2], Failure> {
    let about = machine.about();
    about.travel(axis).ok_or_else(|| {
        let message = format_args!("machine {} has axes {}, no {axis}", about.machine, about.axes);
        Failure::new(EX_USAGE, message)
    })
}

/// A part program of stops: go to the start beside the measurement, then stand at each place in turn. Places are
/// words such as `X1 Y2`.
pub(super) fn stops<'a>(start: &str, places: impl IntoIterator<Item = &'a str>) -> String {
    let mut text = format!("G21 G90 G94 G17\n(SCORE OFF)\nG0 {start}\nF{FEED}\n(SCORE ON)\n");
    for place in places {
        match place.strip_prefix('~') {
            // a place that is passed without a reading
            Some(passed) => text += &format!("(SCORE OFF)\nG1 {passed}\n(SCORE ON)\n"),
            None => text += &format!("G1 {place}\nG4 P{DWELL_S}\n"),
        }
    }
    text + "(SCORE OFF)\nM30\n"
}

/// Displacement of the tool from one point to another along a unit vector, actual minus nominal, um.
pub(super) fn displacement_um(from: &Point, to: &Point, unit: [f64; 3]) -> f64 {
    let along = |f: fn(&Point) -> [f64; 3]| -> f64 {
        let (a, b) = (f(from), f(to));
        (0..3).map(|i| (b[i] - a[i]) * unit[i]).sum()
    };
    1e3 * (along(|p| p.actual_mm) - along(|p| p.nominal_mm))
}
