//! From raw files to a session.

use std::collections::BTreeMap;

use super::super::constants::LITTLE;
use super::super::moment::{Axis, Light, Machine, Moment, Source};
use super::motion::{self, Moves, Run};
use super::motion_notes::{self, Motion, Stated};
use super::pairs::{self, Place};
use super::reflector_location;
use super::{
    Extra, History, Note, ROWS_MAX, ROWS_MIN, Raw, Reading, Session, SessionError, Times, channels, check,
    copies, has_rotation, is_ballbar, is_encoder, times,
};
use volcomp_model::geometry::Vec3;
use volcomp_units::{RAD_PER_DEG, mm_from_um};

/// Columns with a meaning; others are kept for localisation.
const KNOWN: [&str; 18] = [
    "t_s",
    "instrument",
    "setup",
    "run",
    "repeat",
    "pair",
    "u_x",
    "u_y",
    "u_z",
    "deviation_um",
    "predicted_um",
    "moving",
    "tool_length_mm",
    "range_mm",
    "spindle_rpm",
    "line",
    "id",
    "outlier",
];

/// Lags after which an axis follows its command alone: `exp(-10)` is left of some mm.
const SETTLED_LAGS: f64 = 10.0;

/// One file while it is built.
struct Part<'a> {
    raw: &'a Raw,
    file: usize,
    setup: Vec<usize>,
    run: Vec<usize>,
    moments: Vec<Moment>,
    notes: Vec<Note>,
    motion: Motion,
    times: Times,
    /// Time, s, and commanded velocity, mm/s, of the linear axes where samples follow each other fast.
    velocities: [Vec<(f64, f64)>; 3],
    /// Rows of an encoder whose axis still follows what it did before the run begins.
    unsettled: Vec<bool>,
    /// Nothing says which way the axes came.
    undirected: Vec<bool>,
}

impl Session {
    /// Builds a session from files (each on its own clock) and their histories by file.
    ///
    /// # Errors
    /// Missing columns, empty fields, time that runs backwards, units that cannot be right, too few readings.
    pub fn build(raws: &[Raw], mut history: History, machine: Machine) -> Result<Self, SessionError> {
        let mut session = Self {
            readings: Vec::new(),
            moments: Vec::new(),
            files: raws.iter().map(|r| r.file.clone()).collect(),
            times: Vec::with_capacity(raws.len()),
            instruments: Vec::new(),
            setups: Vec::new(),
            reference_lines: Vec::new(),
            ball_zero: None,
            runs: 0,
            axes: Axis::ALL
                .into_iter()
                .filter(|a| raws.iter().any(|r| r.column(&a.column()).is_some()))
                .collect(),
            machine,
            temperatures: Vec::new(),
            signals: Vec::new(),
            has_spindle: false,
            extra: Vec::new(),
            notes: Vec::new(),
            rows_read: raws.iter().map(Raw::len).sum(),
            history: History::default(),
        };
        copies::no_file_twice(raws)?;
        let mut places = Vec::new();
        let mut extra: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        let mut motions = Vec::with_capacity(raws.len());
        for (file, raw) in raws.iter().enumerate() {
            let (times, note) = times::of(raw);
            session.times.push(times);
            match check::file(raw) {
                Ok(notes) => session.notes.extend(notes.into_iter().chain(note)),
                // the others say something
                Err(SessionError::Constant { file, value })
                    if raws.iter().any(|r| check::constant(r).is_none()) =>
                {
                    session.notes.push(Note::new(format!(
                            "{file}: every deviation_um is {value}, so it is left out: nothing was measured, or the resolution \
                            is coarser than all of the gap"
                    )));
                    continue;
                }
                Err(e) => return Err(e),
            }
            sources(raw, file, &mut history);
            let mut part = Part::new(raw, file, &mut session);
            part.state()?;
            let directions_belong_together = |i: usize| {
                raw.instruments.get(i).is_some_and(|n| is_encoder(n) || is_ballbar(n) || has_rotation(n))
            };
            channels::divide(
                &mut part.setup,
                &mut part.moments,
                &mut session.setups,
                directions_belong_together,
            );
            for (axis, points) in Axis::LINEAR.into_iter().zip(&mut part.velocities) {
                history.add(file, Source::Velocity(axis), points.drain(..));
            }
            motions.push((raw.file.as_str(), std::mem::take(&mut part.motion)));
            session.take(part, &mut places, &mut extra);
        }
        session.notes.extend(motion_notes::of(&motions));
        let pairs = pairs::find(&places);
        for (r, p) in session.readings.iter_mut().zip(&pairs) {
            r.pair = *p;
        }
        session.extra = extra.into_iter().map(|(name, values)| Extra { name, values }).collect();
        session.reference_lines = session.straightness_tests();
        let tests = session.setups.iter().zip(&session.reference_lines).filter(|(_, is_test)| **is_test);
        let tests: Vec<&str> = tests.map(|(setup, _)| setup.as_str()).collect();
        if !tests.is_empty() {
            let which = if tests.len() < session.setups.len() {
                format!("{}: ", tests.join(", "))
            } else {
                String::new()
            };
            session.notes.push(Note::new(format!(
                "{which}straightness test of one axis: the slope of each set-up is that of its reference line and says nothing of the machine"
            )));
        }
        session.history = history;
        session.has_spindle = session.history.sources().contains(&Source::Spindle);
        session.temperatures = session
            .history
            .sources()
            .into_iter()
            .filter_map(|s| if let Source::Temperature(n) = s { Some(n) } else { None })
            .collect();
        for m in &mut session.moments {
            m.head = session.machine.head(&m.position);
        }
        reflector_location::aim(&mut session.moments, &session.machine);
        session.drop_copies();
        session.thin();
        if session.readings.len() < ROWS_MIN {
            return Err(SessionError::TooFew { rows: session.readings.len(), limit: ROWS_MIN });
        }
        Ok(session)
    }

    /// Appends the usable rows of a file.
    fn take(&mut self, part: Part<'_>, places: &mut Vec<Place>, extra: &mut BTreeMap<String, Vec<f64>>) {
        let raw = part.raw;
        let deviation = raw.column("deviation_um").unwrap_or(&[]);
        let repeat = raw.column("repeat").unwrap_or(&[]);
        let pair = raw.column("pair");
        let marked = raw.column("outlier");
        let before = self.readings.len();
        let (mut lost, mut unsettled, mut undirected) = (0, 0, 0);
        // short parts would leave nothing
        let settles = 2 * part.unsettled.iter().filter(|u| **u).count() < part.unsettled.len();
        for (i, m) in part.moments.into_iter().enumerate() {
            if !deviation[i].is_finite() {
                lost += 1;
                continue;
            }
            if settles && part.unsettled[i] {
                unsettled += 1;
                continue;
            }
            if part.undirected[i] {
                undirected += 1;
                continue;
            }
            let name = raw.instruments.get(i).map_or("", String::as_str);
            let instrument = self.instruments.iter().position(|n| n == name).unwrap_or_else(|| {
                self.instruments.push(name.to_owned());
                self.instruments.len() - 1
            });
            let (setup, run) = (part.setup[i], part.run[i]);
            places.push(Place {
                class: (part.file, instrument),
                setup,
                repeat: repeat[i] as i64,
                pair: pair.map_or(f64::NAN, |p| p[i]),
                position: m.position,
                direction: m.direction,
                u: [m.u.x, m.u.y, m.u.z],
                tool: m.tool_length_mm,
            });
            self.readings.push(Reading {
                instrument,
                setup,
                run,
                repeat: repeat[i] as i64,
                pair: None,
                deviation_um: deviation[i],
                prediction_um: Vec3::zeros(),
                line: raw.lines[i],
                is_marked: marked.is_some_and(|m| m[i] == 1.0),
            });
            self.moments.push(m);
            for (name, values) in raw.names.iter().zip(&raw.columns).filter(|(n, _)| is_extra(n)) {
                let column = extra.entry(name.clone()).or_default();
                column.resize(self.readings.len() - 1, f64::NAN);
                column.push(values[i]);
            }
        }
        for column in extra.values_mut() {
            column.resize(self.readings.len(), f64::NAN);
        }
        if lost > 0 {
            let of = self.readings.len() - before + lost + unsettled + undirected;
            self.notes.push(Note::new(format!(
                "{}: {lost} of {of} readings are lost (empty deviation_um)",
                raw.file
            )));
        }
        if unsettled > 0 {
            self.notes.push(Note::new(format!(
                "{}: {unsettled} readings within {SETTLED_LAGS} lags of the begin of an uninterrupted part are left out: they depend \
                on motion that is not recorded",
                raw.file
            )));
        }
        if undirected > 0 {
            self.notes.push(Note::new(format!(
                "{}: readings at the first point ({undirected}) are left out: nothing says which way the axes came to it; columns dir_x .. do",
                raw.file
            )));
        }
        self.notes.extend(part.notes);
    }

    /// Leaves out whole points, with all their repeats, until the analysis stays fast.
    fn thin(&mut self) {
        let n = self.readings.len();
        if n <= ROWS_MAX {
            return;
        }
        let every = n.div_ceil(ROWS_MAX);
        // a sample (rows of equal time in a file, of all instruments read together) and all its partners stay or go together;
        // the count runs over programmed points
        let mut chosen: BTreeMap<usize, bool> = BTreeMap::new();
        let mut keep = Vec::with_capacity(n);
        let (mut count, mut last, mut state) = (0usize, (usize::MAX, f64::NAN), false);
        for (r, m) in self.readings.iter().zip(&self.moments) {
            if last != (m.file, m.t_s) {
                state = count.is_multiple_of(every);
                count += 1;
                last = (m.file, m.t_s);
            }
            keep.push(match r.pair {
                Some(p) => *chosen.entry(p).or_insert(state),
                None => state,
            });
        }
        self.retain(&keep);
        let place = match every {
            2 => "second".to_owned(),
            3 => "third".to_owned(),
            // as in 21st, 22nd, 113th
            n if n % 10 == 1 && n % 100 != 11 => format!("{n}st"),
            n if n % 10 == 2 && n % 100 != 12 => format!("{n}nd"),
            n if n % 10 == 3 && n % 100 != 13 => format!("{n}rd"),
            n => format!("{n}th"),
        };
        self.notes.push(Note::new(format!(
            "{n} readings are thinned to {}: every {place} programmed point with all its repeats",
            self.readings.len()
        )));
    }

    pub(super) fn retain(&mut self, keep: &[bool]) {
        fn filter<T>(values: &mut Vec<T>, keep: &[bool]) {
            let mut k = keep.iter();
            values.retain(|_| k.next().is_some_and(|k| *k));
        }
        filter(&mut self.readings, keep);
        filter(&mut self.moments, keep);
        for e in &mut self.extra {
            filter(&mut e.values, keep);
        }
    }
}

fn is_extra(name: &str) -> bool {
    let stems = ["dir_", "since_reversal_", "target_", "lever_", "station_", "force_", "temp_"];
    let ends = ["_mm_per_s", "_mm_per_s2", "_deg_per_s", "_deg_per_s2"];
    !(KNOWN.contains(&name)
        || Axis::ALL.iter().any(|a| a.column() == name)
        || stems.iter().any(|s| name.starts_with(s))
        || ends.iter().any(|e| name.ends_with(e)))
}

/// Spindle and temperatures in the rows join the history of their file.
fn sources(raw: &Raw, file: usize, history: &mut History) {
    let Some(t) = raw.column("t_s") else { return };
    for (name, values) in raw.names.iter().zip(&raw.columns) {
        if let Some((source, unit)) = Source::of_column(name) {
            history.add(file, source, t.iter().copied().zip(values.iter().map(|v| v * unit)));
        }
    }
}

impl<'a> Part<'a> {
    fn new(raw: &'a Raw, file: usize, session: &mut Session) -> Self {
        let n = raw.len();
        let (mut setups, mut runs) = (BTreeMap::new(), BTreeMap::new());
        let (mut setup, mut run) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let columns = ["setup", "run", "repeat"].map(|c| raw.column(c).unwrap_or(&[]));
        let value = |c: usize, i: usize| columns[c].get(i).map_or(0, |v| *v as i64);
        for i in 0..n {
            let s = *setups.entry(value(0, i)).or_insert_with(|| {
                session.setups.push(format!("{}:{}", raw.file, value(0, i)));
                session.setups.len() - 1
            });
            let key = (value(0, i), value(1, i), value(2, i));
            let r = *runs.entry(key).or_insert_with(|| {
                session.runs += 1;
                session.runs - 1
            });
            setup.push(s);
            run.push(r);
        }
        let times = session.times.get(file).copied().unwrap_or_default();
        let velocities = Default::default();
        Self {
            raw,
            file,
            setup,
            run,
            moments: Vec::new(),
            notes: Vec::new(),
            motion: Motion::default(),
            times,
            velocities,
            unsettled: vec![false; n],
            undirected: vec![false; n],
        }
    }

    /// The state of every row: stated columns first, what is missing from the motion.
    fn state(&mut self) -> Result<(), SessionError> {
        let raw = self.raw;
        let column = |name: &str| raw.column(name);
        let triple =
            |stem: &str, unit: &str| ["x", "y", "z"].map(|a| raw.column(&format!("{stem}{a}{unit}")));
        let (t, u) = (column("t_s").unwrap_or(&[]), triple("u_", ""));
        let (target, station, force) =
            (triple("target_", "_mm"), triple("station_", "_mm"), triple("force_", "_n"));
        let lever = triple("lever_", "_mm");
        let (tool, range) = (column("tool_length_mm"), column("range_mm"));
        let at = |c: Option<&[f64]>, i: usize| c.map_or(f64::NAN, |c| c[i]);
        let vector = |c: [Option<&[f64]>; 3], i: usize| Vec3::new(at(c[0], i), at(c[1], i), at(c[2], i));
        self.moments = (0..raw.len())
            .map(|i| Moment {
                t_s: t[i],
                file: self.file,
                u: vector(u, i).normalize(),
                tool_length_mm: at(tool, i),
                range_mm: at(range, i),
                target_mm: vector(target, i),
                lever_mm: vector(lever, i),
                light: raw.instruments.get(i).and_then(|n| Light::of(n)),
                setup: self.setup[i],
                is_ballbar: raw.instruments.get(i).is_some_and(|n| is_ballbar(n)),
                is_encoder: raw.instruments.get(i).is_some_and(|n| is_encoder(n)),
                station_mm: vector(station, i),
                force_n: [at(force[0], i), at(force[1], i), at(force[2], i)],
                ..Moment::default()
            })
            .collect();
        let runs = self.runs();
        for axis in Axis::ALL {
            self.axis(axis, &runs)?;
        }
        self.mark_undirected(&runs);
        Ok(())
    }

    /// The runs of the file, each with its motion.
    fn runs(&self) -> Vec<Run> {
        let raw = self.raw;
        let t = raw.column("t_s").unwrap_or(&[]);
        let positions: Vec<(Axis, &[f64])> =
            Axis::ALL.into_iter().filter_map(|a| Some((a, raw.column(&a.column())?))).collect();
        let moving = raw.column("moving");
        let unit = |a: &Axis| if a.is_linear() { "mm" } else { "deg" };
        let speeds: Vec<&[f64]> =
            Axis::ALL.iter().filter_map(|a| raw.column(&format!("v{a}_{}_per_s", unit(a)))).collect();
        let mut runs = Vec::new();
        let mut first = 0;
        while first < raw.len() {
            let end = (first..raw.len()).find(|i| self.run[*i] != self.run[first]).unwrap_or(raw.len());
            let mut rows = first..end;
            let is_moving = moving.is_some_and(|m| m[first..end].contains(&1.0));
            let is_stated = is_moving || speeds.iter().any(|v| v[first..end].iter().any(|v| v.abs() > 0.0));
            let moves = if is_stated && self.times != Times::Ordinal {
                Moves::Stated
            } else if (is_moving || moving.is_none())
                && rows.all(|i| raw.instruments.get(i).is_some_and(|n| is_ballbar(n)))
            {
                Moves::OnCircles
            } else {
                Moves::Unknown
            };
            runs.push(Run::of(t, [first, end], &positions, moves));
            first = end;
        }
        runs
    }

    /// Position, speed, acceleration, direction and reversals of one axis.
    fn axis(&mut self, axis: Axis, runs: &[Run]) -> Result<(), SessionError> {
        let raw = self.raw;
        let (slot, unit) = (axis.slot(), if axis.is_linear() { 1.0 } else { RAD_PER_DEG });
        let length = if axis.is_linear() { "mm" } else { "deg" };
        let Some(position) = raw.column(&axis.column()) else {
            // an axis without a column stands still at zero
            for m in &mut self.moments {
                (m.velocity[slot], m.acceleration[slot], m.direction[slot]) = (0.0, 0.0, 0.0);
                (m.since_mm[slot], m.since_s[slot]) = (f64::INFINITY, f64::INFINITY);
            }
            return Ok(());
        };
        let stated = |name: String| raw.column(&name);
        let speed = stated(format!("v{axis}_{length}_per_s"));
        let acceleration = stated(format!("a{axis}_{length}_per_s2"));
        let direction = stated(format!("dir_{axis}"));
        let since = stated(format!("since_reversal_{axis}_{length}"));
        let since_s = stated(format!("since_reversal_{axis}_s"));
        let moving = raw.column("moving");
        let ordinal = self.times == Times::Ordinal;
        let of_control = raw.instruments.first().is_some_and(|n| is_encoder(n));
        let (mut derived, mut fast_rows, mut any_fast, mut any_circle) =
            (vec![0.0; raw.len()], vec![false; raw.len()], false, false);
        // where the run before left it, and which way it went
        let (mut left, mut went) = (f64::NAN, 0.0);
        for run in runs {
            let Run { samples, in_motion, circle, .. } = run;
            // no speed follows from an order
            let fast = *in_motion && !ordinal;
            let places: Vec<f64> = samples.iter().map(|s| position[s.first]).collect();
            // an axis of the control's own encoders turns round later than on the circle of its commands
            let circle = circle.as_ref().filter(|_| axis.is_linear() && !of_control);
            let circle = circle.and_then(|c| c.component(slot));
            any_fast |= fast;
            any_circle |= circle.is_some();
            let (v, a) = match circle {
                Some(circle) if fast => circle.derivatives(),
                _ if fast => motion::derivatives(samples, &places),
                _ => (vec![0.0; samples.len()], vec![0.0; samples.len()]),
            };
            if fast && axis.is_linear() {
                let velocities = &mut self.velocities[slot];
                match speed {
                    Some(speed) => velocities.extend(samples.iter().map(|s| (s.t, speed[s.first]))),
                    None if circle.is_some() => velocities.extend(samples.iter().map(|s| s.t).zip(v.clone())),
                    None => velocities.extend(motion::velocities(samples, &places, of_control)),
                }
            }
            let given: Option<Vec<f64>> = direction.map(|d| samples.iter().map(|s| d[s.first]).collect());
            // the control's own encoders tell how late the axis follows: it turns round when it does, not when it is told to
            let reached = if of_control && fast && axis.is_linear() {
                let following = self.following(axis, samples);
                let lag_s = motion::lag_s(&following, &v);
                let settled_s = samples.first().map_or(0.0, |s| s.t) + SETTLED_LAGS * lag_s;
                let (reached, goes_on) =
                    motion::reached(axis, samples, &places, &following, [lag_s, settled_s]);
                if !goes_on {
                    self.mark_unsettled(axis, samples, settled_s);
                }
                reached
            } else {
                places
            };
            let way = reached.first().map_or(0.0, |first| first - left);
            let came = if way.abs() > motion::MOVED { way.signum() } else { went };
            let travel = match circle {
                Some(circle) => circle.travel(samples, given.as_deref()),
                None => motion::travel(run, &reached, given.as_deref(), came),
            };
            left = reached.last().copied().unwrap_or(left);
            went = travel.direction.last().copied().unwrap_or(went);
            for (k, s) in samples.iter().enumerate() {
                for i in s.first..s.end {
                    let still = moving.is_some_and(|m| m[i] == 0.0);
                    derived[i] = v[k];
                    fast_rows[i] = fast;
                    let m = &mut self.moments[i];
                    m.position[slot] = position[i] * unit;
                    m.velocity[slot] = given_or(speed, i, if still { 0.0 } else { v[k] }) * unit;
                    m.acceleration[slot] = given_or(acceleration, i, if still { 0.0 } else { a[k] }) * unit;
                    m.direction[slot] = travel.direction[k];
                    m.since_mm[slot] = given_or(since, i, travel.since[k]) * unit;
                    // no duration holds in ordinal times: a reading at rest was taken long after the reversal
                    let derived_s = if ordinal { f64::INFINITY } else { travel.since_s[k] };
                    m.since_s[slot] = given_or(since_s, i, derived_s);
                }
            }
        }
        if let Some(speed) = speed {
            let known: Vec<f64> =
                speed.iter().zip(&fast_rows).map(|(s, f)| if *f { *s } else { f64::NAN }).collect();
            if let Some(ratio) = check::speed_ratio(&known, &derived)
                && check::unit_slip(ratio)
            {
                return Err(SessionError::Unit {
                    file: raw.file.clone(),
                    column: format!("v{axis}_{length}_per_s"),
                    what: format!("is {ratio:.4} times the speed that {} and t_s give", axis.column()),
                    remedy: "check the units of time, position and speed",
                });
            }
        }
        if position.iter().any(|p| (p - position[0]).abs() * unit > 1e-9) {
            let stated = Stated {
                velocity: speed.is_some(),
                acceleration: acceleration.is_some(),
                direction: direction.is_some(),
                since: since.is_some(),
                since_s: since_s.is_some(),
            };
            self.motion.tell(axis, any_fast, any_circle, stated);
        }
        Ok(())
    }

    /// What the encoder of a linear axis sees it behind its command by at each sample, mm; NaN where it is not read.
    fn following(&self, axis: Axis, samples: &[motion::Sample]) -> Vec<f64> {
        let deviation = self.raw.column("deviation_um").unwrap_or(&[]);
        let along = |i: &usize| self.moments[*i].u[axis.slot()];
        let row =
            |s: &motion::Sample| (s.first..s.end).find(|i| along(i) != 0.0 && deviation[*i].is_finite());
        samples.iter().map(|s| row(s).map_or(f64::NAN, |i| -mm_from_um(deviation[i]) / along(&i))).collect()
    }

    /// On a path with corners the axes come to the first sample of a file from anywhere. A short run cannot do without it.
    fn mark_undirected(&mut self, runs: &[Run]) {
        let is_stated = |axis: &Axis| self.raw.column(&format!("dir_{axis}")).is_some();
        let is_long = |run: &&Run| LITTLE * run.samples.len() as f64 >= 1.0;
        let first = runs.first().filter(|run| run.has_corners && !run.in_motion).filter(is_long);
        if let Some(run) = first
            && !Axis::LINEAR.iter().any(is_stated)
        {
            self.undirected[run.samples[0].first..run.samples[0].end].fill(true);
        }
    }

    /// What a lag does depends on the motion before the first sample of a run, which nobody recorded.
    fn mark_unsettled(&mut self, axis: Axis, samples: &[motion::Sample], settled_s: f64) {
        for i in samples.iter().take_while(|s| s.t < settled_s).flat_map(|s| s.first..s.end) {
            self.unsettled[i] |= self.moments[i].u[axis.slot()] != 0.0;
        }
    }
}

fn given_or(column: Option<&[f64]>, i: usize, otherwise: f64) -> f64 {
    column.map(|c| c[i]).filter(|v| !v.is_nan()).unwrap_or(otherwise)
}
