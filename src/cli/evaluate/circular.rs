//! `evaluate iso230-4`: circular test.

use core::f64::consts::TAU;

use clap::ValueEnum;

use super::page;
use super::picture::circular::{self as drawing, Shown};
use super::{
    CompareOptions, Compared, Figures, Output, assess, before_and_after, headed, side_by_side, values,
};
use crate::identify::Columns;
use crate::identify::ballbar::{lines_and_samples, reading};
use crate::positioning_data::no_rows;
use crate::prelude::*;
use volcomp_evaluate::{Centring, CircularReading, CircularUncertainties, Circularity, Placed};
use volcomp_identify::ballbar::{Sample, cut_overshoot, travelled};

const UNCERTAINTY: &str = "Uncertainty of the measurement (k = 2)";
const STANDARD: &str = "Circular test, ISO 230-4:2022";

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CentringArg {
    /// Take the eccentricity out with the geometric least-squares circle.
    LeastSquares,
    /// Keep the instrument's own centre.
    None,
}

/// Circular test by ISO 230-4: circular error G and radial error F
///
/// Angles count from the first axis of the plane towards the second. Files of `volcomp identify ballbar` and
/// `cncsim measure ballbar` are read as they are: what a run travels beyond one turn is overshoot and is cut, half at
/// either end; a file with several feeds needs --feed-mm-per-min.
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// CSV with angle_deg,deviation_um,direction (1 counter-clockwise, -1 clockwise), optional feed_mm_per_min and run; - is stdin.
    #[arg(long, value_name = "FILE", required_unless_present = "file")]
    data: Option<PathBuf>,
    /// The same test at an earlier time, to compare with.
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,
    /// How the centre is found.
    #[arg(long, value_enum, default_value = "least-squares")]
    centring: CentringArg,
    /// Nominal radius; makes the centring exact for large eccentricities.
    #[arg(long, value_name = "MM")]
    radius_mm: Option<f64>,
    /// The feed to evaluate, of a file with several.
    #[arg(long, value_name = "FEED")]
    feed_mm_per_min: Option<f64>,
    /// Overshoot at either end of each run, of an arc; of full circles it is what exceeds one turn.
    #[arg(long, value_name = "DEG")]
    overshoot_deg: Option<f64>,
    /// Expanded uncertainty (k = 2) of a change of the reading over the circle, from the certificate of the instrument.
    #[arg(long, value_name = "UM", value_parser = not_negative, help_heading = UNCERTAINTY)]
    u_device_um: Option<f64>,
    /// Expanded uncertainty (k = 2) of the calibrated length; radial errors F need it.
    #[arg(long, value_name = "UM", value_parser = not_negative, help_heading = UNCERTAINTY)]
    u_length_um: Option<f64>,
    /// Range of the reading of the resting machine over the time of the test.
    #[arg(long, value_name = "UM", value_parser = not_negative, help_heading = UNCERTAINTY)]
    drift_um: Option<f64>,
    /// The plane of the circle, for the plot: first and second axis.
    #[arg(long, value_name = "AXES", default_value = "xy", value_parser = plane)]
    plane: [char; 2],
    #[command(flatten)]
    output: Output,
}

pub(crate) fn plane(text: &str) -> Result<[char; 2], String> {
    let axes: Vec<char> = text.chars().map(|c| c.to_ascii_uppercase()).collect();
    match axes[..] {
        [a, b] if a != b && a.is_ascii_alphabetic() && b.is_ascii_alphabetic() => Ok([a, b]),
        _ => Err(format!("invalid plane '{text}'; write two axes such as xy, yz or zx")),
    }
}

/// A test with its readings.
struct Evaluated {
    readings: Vec<CircularReading>,
    result: Circularity,
    /// Feed, where it is stated or the file has one, mm/min.
    feed: Option<f64>,
    uncertainties: CircularUncertainties,
}

impl Evaluated {
    fn shown(&self, plane: [char; 2], radius_mm: Option<f64>) -> Shown<'_> {
        Shown { result: &self.result, readings: &self.readings, plane, radius_mm }
    }
}

/// The samples of a file, of which there must be one; feeds as written, mm/min.
pub(crate) fn samples(path: &Path) -> Result<Vec<Sample>> {
    let found = lines_and_samples(path, Columns::value)?;
    if found.is_empty() {
        Err(no_rows(&table::name_of(path)))
    } else {
        Ok(found.into_iter().map(|f| f.1).collect())
    }
}

fn read(
    path: &Path,
    centring: Centring,
    wanted_feed: Option<f64>,
    overshoot: Option<f64>,
    uncertainties: CircularUncertainties,
) -> Result<Evaluated> {
    let samples = of_one_feed(wanted_feed, path, samples(path)?)?;
    let values = samples.iter().map(|s| (um_from_mm(s.deviation), 0));
    check_size(&path.display().to_string(), "deviation_um", values, false)?;
    // a file that is not in the order of the readings says nothing about overshoot
    let in_order = travelled(&samples).iter().all(|angle| *angle > 0.0);
    let measured =
        if in_order || overshoot.is_some() { cut_overshoot(&samples, overshoot) } else { samples.clone() };
    let cut = samples.len() - measured.len();
    if cut > 0 {
        let (file, all) = (path.display(), samples.len());
        note!("note: {file}: {cut} of {all} readings are overshoot and are not evaluated");
    }
    let readings: Vec<CircularReading> = measured.iter().map(reading).collect();
    let result = Circularity::evaluate(&readings, centring).map_err(|e| data!(path, "{e}"))?;
    let feed = wanted_feed.or_else(|| samples.first().and_then(|s| s.feed));
    Ok(Evaluated { readings, result, feed, uncertainties })
}

/// The readings of the feed asked for; of several feeds one must be.
fn of_one_feed(wanted: Option<f64>, path: &Path, samples: Vec<Sample>) -> Result<Vec<Sample>> {
    let mut feeds: Vec<f64> = samples.iter().filter_map(|s| s.feed).collect();
    feeds.sort_by(f64::total_cmp);
    feeds.dedup();
    let list = || feeds.iter().map(f64::to_string).joined(", ");
    match wanted {
        Some(wanted) if feeds.contains(&wanted) => {
            Ok(samples.into_iter().filter(|s| s.feed == Some(wanted)).collect())
        }
        Some(wanted) if !feeds.is_empty() => {
            Err(usage!("{}: no readings at {wanted} mm/min; the feeds are {}", path.display(), list()))
        }
        None if feeds.len() > 1 => {
            let what = "the standard evaluates one feed: give --feed-mm-per-min";
            Err(data!(path, "readings at {} mm/min; {what}", list()))
        }
        _ => Ok(samples),
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let centring = match args.centring {
        CentringArg::LeastSquares => Centring::LeastSquares { radius: args.radius_mm },
        CentringArg::None => Centring::None,
    };
    let overshoot = args.overshoot_deg.map(rad_from_deg);
    let u = CircularUncertainties::of(args.u_device_um, args.u_length_um, args.drift_um);
    let read = |path: &Path| read(path, centring, args.feed_mm_per_min, overshoot, u);
    let mut acceptance = Acceptance::load(&args.output.head, "iso230-4", &keys())?;
    let after = read(args.output.data(&args.data))?;
    acceptance.fill(Stated { feed_mm_per_min: after.feed, ..Stated::default() });
    let judged = Judged { figures: assessed(&acceptance, &after.result, after.uncertainties), acceptance };
    let before = args.before.as_deref().map(read).transpose()?;
    let old = before.as_ref().map(|b| assessed(&Acceptance::default(), &b.result, b.uncertainties));
    let title = args.output.title("Circular test");
    let after_shown = after.shown(args.plane, args.radius_mm);
    let pictures = headed(before.as_ref().map(|b| b.shown(args.plane, args.radius_mm)), after_shown);
    let division = drawing::scale(pictures.iter().map(|(_, shown)| shown));
    args.output.deliver(
        &judged,
        || drawing::whole(title, &pictures, division),
        || report(args, title, &judged, &after, old.as_deref(), &pictures),
        || {
            let before = before.as_ref().zip(old.as_deref()).map(|(before, old)| as_json(old, before));
            (as_json(&judged.figures, &after), before)
        },
        || {
            let file = args.output.data(&args.data).display();
            say!("ISO 230-4 of {file}: {}", counted(after.readings.len(), "reading"));
            page::figures("um", &judged.figures, old.as_deref()).print();
            let [x, y] = after.result.centre.map(um_from_mm);
            say!("centre taken out  {}, {} µm", plain(x, 1), plain(y, 1));
        },
    )
}

/// Key, term of ISO 230-4:2022, and how a figure is taken from a test.
const FIGURES: &Figures<Circularity> = &[
    ("g_fwd_um", "circular error G, counter-clockwise", |c| c.g_forward.map(um_from_mm)),
    ("g_bwd_um", "circular error G, clockwise", |c| c.g_backward.map(um_from_mm)),
    ("g_bi_um", "bidirectional circular error G(b)", |c| c.g_both.map(um_from_mm)),
    ("fmax_um", "radial error Fmax", |c| Some(um_from_mm(c.f_max))),
    ("fmin_um", "radial error Fmin", |c| Some(um_from_mm(c.f_min))),
];

/// Keys of the figures that may have a tolerance.
pub(super) fn keys() -> Vec<String> {
    FIGURES.iter().map(|(key, ..)| (*key).to_owned()).collect()
}

/// The figures of a test with tolerances and stated uncertainties.
pub(super) fn assessed(
    acceptance: &Acceptance,
    result: &Circularity,
    u: CircularUncertainties,
) -> Vec<Assessed> {
    assess(FIGURES, result, acceptance, "", |key| if key.starts_with('g') { u.g } else { u.f })
}

fn as_json(figures: &[Assessed], test: &Evaluated) -> Map<String, Value> {
    let mut out = values(figures);
    out.insert("centre_um".to_owned(), json!(test.result.centre.map(um_from_mm)));
    out.insert("readings".to_owned(), json!(test.readings.len()));
    out
}

fn report(
    args: &Args,
    title: &str,
    judged: &Judged,
    after: &Evaluated,
    old: Option<&[Assessed]>,
    pictures: &[(&str, Shown<'_>)],
) -> Result<String> {
    let [a, b] = args.plane;
    let mut facts = vec![("plane", format!("{a}{b}, angles from {a} towards {b}"))];
    facts.extend(args.radius_mm.map(|r| ("nominal radius", format!("{r} mm"))));
    facts.push(("readings", after.readings.len().to_string()));
    let [x, y] = after.result.centre.map(um_from_mm);
    let centre = match args.centring {
        CentringArg::LeastSquares => {
            format!("least-squares circle; taken out {}, {} µm", plain(x, 1), plain(y, 1))
        }
        CentringArg::None => "that of the instrument".to_owned(),
    };
    facts.push(("centre", centre));
    let mut page = args.output.page([&args.data, &args.before], (title, STANDARD), judged, &facts);
    page::figures("µm", &judged.figures, old).put(&mut page);
    let caption = "Radial deviations about the common centre, magnified; the heavy circle is the nominal path. F is the radial \
                   error against the nominal radius, G the range of the radii of one path (G(b): of both).";
    let scale = drawing::scale(pictures.iter().map(|(_, shown)| shown));
    let plot = |(_, one): &(&str, Shown<'_>)| drawing::single(one, scale);
    match pictures {
        [before, after] => {
            page.sheet("Before");
            page.plots(&[("", plot(before)?), ("After, same scale", plot(after)?)], caption);
        }
        all => {
            all.iter().try_for_each(|one| plot(one).map(|svg| page.plots(&[("Polar plot", svg)], caption)))?
        }
    }
    Ok(page::finish(page, judged))
}

/// Sectors of a circle in which readings are averaged.
const SECTORS: f64 = 360.0;

/// Two tests for `volcomp verify`: radial deviations about the common least-squares circle.
pub(super) fn compare(files: [&Path; 2], options: CompareOptions) -> Result<Compared> {
    let centring = Centring::LeastSquares { radius: options.radius_mm };
    let u = CircularUncertainties::of(options.u_device, None, None);
    let read = |path: &Path| read(path, centring, options.feed_mm_per_min, None, u);
    let [before, after] = [read(files[0])?, read(files[1])?];
    let shown = [&before, &after].map(|test| test.shown(options.plane, options.radius_mm));
    let scales = [&shown[..], &shown[1..]].map(|tests| [0.0, drawing::scale(tests)]);
    let plots = before_and_after(shown.each_ref(), scales, |test, [_, scale]| drawing::single(test, scale))?;
    let figures = side_by_side(
        [&before, &after].map(|test| assessed(&Acceptance::default(), &test.result, test.uncertainties)),
    );
    Ok(Compared {
        test: "iso230-4",
        standard: STANDARD,
        keys: keys(),
        stated: Stated { feed_mm_per_min: after.feed, ..Stated::default() },
        unit: "µm",
        figures,
        about: [", about the fitted centre", ", about the nominal circle at the fitted centre"],
        plots,
        caption: "Radial deviations about the common centre, magnified; the heavy circle is the nominal path.",
        readings: [placed(&before), placed(&after)],
        is_repeated: false,
        notes: vec!["Readings are averaged in sectors of 1 deg, each direction apart.".to_owned()],
    })
}

fn placed(test: &Evaluated) -> Vec<Placed> {
    let [x, y] = test.result.centre;
    let one = |r: &CircularReading| {
        let about = r.deviation - x * r.angle.cos() - y * r.angle.sin();
        let sector = (r.angle.rem_euclid(TAU) / TAU * SECTORS) as i64;
        let reverse = i64::from(r.travel == volcomp_units::axes::Travel::Reverse);
        Placed { curve: 0, place: 2 * sector + reverse, value: um_from_mm(about) }
    };
    test.readings.iter().map(one).collect()
}
