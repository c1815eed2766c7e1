//! `volcomp identify probe`: effective radius of a touch probe's ball, from contacts with a gauge bar.

use crate::identify::prelude::*;
use volcomp_identify::probe::{Arm, Calibration, Circle, Contact, Note, Request, calibrate};

/// Effective radius of a touch probe and the place of a gauge bar, from contacts around the bar.
///
/// The probe sits on an arm that swings about B and touches a round bar of known radius. The centre of its ball then
/// lies on a circle; that circle's radius less the bar's is the effective radius of the ball, its centre is where the
/// bar's axis really is.
///
/// Columns of --data: y_mm and b_deg at contact (with --arm-mm and --arm-zero-deg: the height is arm * sin(B - zero)),
/// or y_mm and z_mm. Touch the bar from both sides and over as long an arc as the stylus reaches: with one side only,
/// 1 um of noise becomes 4 um and more in radius and centre, and the report says so.
///
/// With --out or --into the place of the bar is written as location errors ey0a and ez0a of the axis that holds it: the
/// bar must run true in that axis, and --nominal-mm says where Y and the height over B should be.
///
/// Example: volcomp identify probe --data contacts.csv --arm-mm 173.7135 --arm-zero-deg=-39.025 --bar-radius-mm 15
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Contacts; - is stdin.
    #[arg(
        long,
        value_name = "CSV",
        requires = "bar_radius_mm",
        conflicts_with = "input",
        required_unless_present_any = ["input", "file"]
    )]
    data: Option<PathBuf>,
    /// Radius of the gauge bar.
    #[arg(long, value_name = "MM")]
    bar_radius_mm: Option<f64>,
    /// Distance of the ball's centre from the B axis.
    #[arg(long, value_name = "MM", requires = "arm_zero_deg")]
    arm_mm: Option<f64>,
    /// B at which the ball stands level with the B axis.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "arm_mm")]
    arm_zero_deg: Option<f64>,
    /// Nominal radius of the ball, for comparison.
    #[arg(long, value_name = "MM")]
    ball_radius_mm: Option<f64>,
    /// Noise of a contact (standard deviation), where known: the fit is then tested against it.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    noise_um: Option<f64>,
    /// Reject contacts that lie off the circle by more than 4.5 standard deviations (at most a tenth of them).
    #[arg(long, alias = "reject-outliers")]
    robust: bool,
    /// Where the bar's axis should be: Y and height over the B axis.
    #[arg(long, value_name = "Y,Z", value_parser = pair, allow_hyphen_values = true)]
    nominal_mm: Option<[f64; 2]>,
    #[command(flatten)]
    out: ModelWriter,
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers(text).ok_or_else(|| format!("invalid pair of numbers '{text}'; write for example 168.8,0"))
}

/// A case of the vectors: mm, and degrees where the name says so.
#[derive(Deserialize)]
struct Case {
    #[serde(rename = "R_bar")]
    bar_radius: f64,
    #[serde(rename = "L_R")]
    arm: f64,
    #[serde(rename = "B_c_deg")]
    arm_zero_deg: f64,
    #[serde(rename = "Y")]
    y: Vec<f64>,
    #[serde(rename = "B_deg")]
    b_deg: Vec<f64>,
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        Front { case_writes: true, ..self.case.front(&self.out) }
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        self.needs_nominal()?;
        let case: Case = file.read()?;
        if case.y.len() != case.b_deg.len() {
            let (y, b) = (case.y.len(), case.b_deg.len());
            return Err(file.bad(format_args!("{y} values of Y but {b} of B_deg")));
        }
        let arm = Arm { length: case.arm, zero: rad_from_deg(case.arm_zero_deg) };
        let contact = |(y, b): (&f64, &f64)| arm.contact(*y, rad_from_deg(*b));
        let contacts = case.y.iter().zip(&case.b_deg).map(contact).collect();
        self.outcome(file.path, contacts, case.bar_radius)
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        self.needs_nominal()?;
        let path = self.case.required(&self.data)?;
        let bar = self.bar_radius_mm.ok_or_else(|| usage!("give --bar-radius-mm"))?;
        self.outcome(path, self.contacts(path)?, bar).map(Some)
    }
}

impl Args {
    fn needs_nominal(&self) -> Result<()> {
        if self.out.target().is_some() == self.nominal_mm.is_some() {
            return Ok(());
        }
        Err(usage!("a model needs --out or --into, and --nominal-mm to compare the bar's place with"))
    }

    fn contacts(&self, path: &Path) -> Result<Vec<Contact>> {
        let mut table = table::open(path)?;
        let (y, height, angle) =
            (table.column("y_mm")?, table.find_column("z_mm"), table.find_column("b_deg"));
        table.only_known()?;
        let arm = self.arm_mm.zip(self.arm_zero_deg);
        let arm = arm.map(|(length, zero)| Arm { length, zero: rad_from_deg(zero) });
        match (height, arm) {
            (Some(z), None) => table.rows(|row| Ok(Contact { y: row.value(y)?, z: row.value(z)? })),
            (None, Some(arm)) => {
                let b = angle.map_or_else(|| table.column("b_deg"), Ok)?;
                table.rows(|row| Ok(arm.contact(row.value(y)?, row.value(b)?)))
            }
            (Some(_), Some(_)) => {
                Err(usage!("--arm-mm goes with a column b_deg; the file has heights (z_mm)"))
            }
            (None, None) => {
                Err(usage!("give --arm-mm and --arm-zero-deg for the column b_deg, or a column z_mm"))
            }
        }
    }

    fn outcome(&self, path: &Path, contacts: Vec<Contact>, bar_radius: f64) -> Result<Box<dyn Found + '_>> {
        let request = Request { sigma: self.noise_um.map(mm_from_um), reject_outliers: self.robust };
        let found = calibrate(&contacts, bar_radius, &request).map_err(|e| Failure::data(path, e))?;
        Ok(Box::new(Outcome { args: self, path: path.to_owned(), found, contacts: contacts.len() }))
    }
}

/// A calibration and what it was made from.
struct Outcome<'a> {
    args: &'a Args,
    path: PathBuf,
    found: Calibration,
    contacts: usize,
}

impl Found for Outcome<'_> {
    /// The keys of the vectors, and more. mm and rad.
    fn json(&self) -> Value {
        let found = &self.found;
        let circle = |c: &Circle| json!({"Y0": c.y0, "Z0": c.z0, "R_c": c.radius});
        let covariance = found.covariance().map(|c| [0, 1, 2].map(|i| [0, 1, 2].map(|j| c[(i, j)])));
        fields!(found; rms_radial, sigma, arc;
            "kasa": circle(&found.kasa),
            "geometric": circle(&found.geometric),
            "r_c_geometric": found.probe_radius,
            "r_c_kasa": found.probe_radius_kasa,
            "cond_raw_normal_matrix": found.condition_raw_normal,
            "covariance": covariance,
            "r_c_std": covariance.map(|c| c[2][2].sqrt()),
            "p_value": found.test.map(|t| t.p_value),
            "outliers": found.outliers.iter().map(|i| i + 1).collect::<Vec<_>>(),
            "notes": found.notes.iter().map(|n| note(n, found)).collect::<Vec<_>>(),
        )
    }

    fn print(&self) {
        let (args, found) = (self.args, &self.found);
        let std = found.covariance().map(|c| [0, 1, 2].map(|i| um_from_mm(c[(i, i)].sqrt())));
        let width = found.coverage_95();
        let row = |name: &str, value: f64, kasa: f64, k: usize| {
            let interval =
                std.map_or_else(|| "-".to_owned(), |s| format!("{:>8.3} {:>10.3}", s[k], width * s[k]));
            say!("{name:<28}{value:>14.5}{kasa:>14.5}{interval:>20}");
        };
        let (geometric, kasa) = (&found.geometric, &found.kasa);
        say!("{} contacts over {:.0} deg of the bar", self.contacts, found.arc.to_degrees());
        say_text!("{:<28}{:>14}{:>14}{:>20}", "", "geometric/mm", "algebraic/mm", "std/µm     95 %/µm");
        row("effective ball radius r_c", found.probe_radius, found.probe_radius_kasa, 2);
        row("circle of contact R_c", geometric.radius, kasa.radius, 2);
        row("bar's axis Y0", geometric.y0, kasa.y0, 0);
        row("bar's axis Z0 (over B axis)", geometric.z0, kasa.z0, 1);
        if let Some(nominal) = args.ball_radius_mm {
            let less = um_from_mm(found.probe_radius - nominal);
            say_text!("r_c less the nominal radius of the ball: {less:.2} um");
        }
        let (rms, sigma) = (um_from_mm(found.rms_radial), or_dash(found.sigma.map(um_from_mm), 3));
        say_text!("distances from the circle: rms {rms:.3} um, noise {sigma} um");
        if let Some(test) = &found.test {
            say!("fit against the stated noise: chi2 {:.1}, probability {:.3}", test.chi2, test.p_value);
        }
        if !found.outliers.is_empty() {
            let what = if args.robust { "rejected" } else { "kept; --robust rejects them" };
            let one = |&i: &usize| format!("{} ({:+.2} um)", i + 1, um_from_mm(found.residuals[i]));
            let list = found.outliers.iter().map(one).joined(", ");
            note!("note: contacts off the circle by more than noise: {list} ({what})");
        }
        for n in &found.notes {
            note!("note: {}", note(n, found));
        }
    }

    /// The bar's place as location errors of the axis that holds it.
    fn write(&self, _end: &mut String) -> Result<()> {
        let (args, found) = (self.args, &self.found);
        let Some([y, z]) = args.nominal_mm else { return Ok(()) };
        let mut model = args.out.base(|| "[w A' b X Y B t]".to_owned())?;
        let files = [self.path.clone()];
        let sources = Sources::of(&files);
        let covariance = found.covariance();
        for (component, value, k) in
            [(Component::Y, found.geometric.y0 - y, 0), (Component::Z, found.geometric.z0 - z, 1)]
        {
            let std = covariance.map(|c| c[(k, k)].sqrt());
            let function = ErrorFunction { std, ..ErrorFunction::single(Curve::Constant(value)) };
            let symbol = ErrorSymbol::Location { component, axis: AxisName::A };
            model.put(symbol, function, sources.provenance());
        }
        if let Some(arm) = args.arm_mm {
            let arcsec = arcsec_from_rad(mm_from_um(1.0) / arm);
            note!("note: ez0a holds the zero of B, too: 1 um is {arcsec:.2} arcsec of B on this arm");
        }
        args.out.write(&model, &sources.comments(), &files)
    }
}

fn note(note: &Note, found: &Calibration) -> String {
    match note {
        Note::OneSided { arc, amplification } => {
            let error = found.covariance().map_or_else(String::new, |c| {
                format!(" ({:.1} um at 95 %)", found.coverage_95() * um_from_mm(c[(2, 2)].sqrt()))
            });
            format!(
                "the contacts cover {:.0} deg of the bar only: the radius is {amplification:.0} times as uncertain as from contacts all around{error}; touch it from both sides",
                arc.to_degrees()
            )
        }
        Note::MoreThanNoise { p_value } => format!(
            "the distances from the circle are larger than the stated noise explains (probability {p_value:.1e}): the uncertainties are from the distances; is the bar round, the arm's length right?"
        ),
    }
}
