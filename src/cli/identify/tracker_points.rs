//! Points in CSV files: named points with coordinates, or with range, azimuth and elevation from a tracker, and the
//! registration of the tracker's frame to the machine's.

use crate::identify::prelude::*;
use volcomp_identify::primitives::{RigidFit, procrustes, register};
use volcomp_identify::threepoint::{Observation, TrackerNoise};
use volcomp_model::geometry::Mat3;

/// What is known of the instrument.
#[derive(Debug, clap::Args)]
pub(super) struct TrackerArgs {
    /// Standard deviation of a Cartesian coordinate, um; without it the noise is estimated from the data.
    #[arg(long, value_name = "UM", value_parser = above_zero, alias = "sigma-um")]
    noise_um: Option<f64>,
    /// Standard deviation of a range, um.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    sigma_range_um: Option<f64>,
    /// Part of the range's standard deviation that grows with it, um/m.
    #[arg(long, value_name = "UM/M", default_value = "0", value_parser = not_negative)]
    sigma_range_um_per_m: f64,
    /// Standard deviation of azimuth and elevation, arcsec.
    #[arg(long, value_name = "ARCSEC", value_parser = above_zero)]
    sigma_angle_arcsec: Option<f64>,
    /// Reference points seen by the instrument and known in the machine frame: CSV with point, machine_x_mm,
    /// machine_y_mm, machine_z_mm and x_mm, y_mm, z_mm (or range_mm, azimuth_deg, elevation_deg).
    #[arg(long, value_name = "FILE")]
    registration: Option<PathBuf>,
    /// Standard deviation of the machine coordinates of the reference points, um.
    #[arg(long, value_name = "UM", default_value = "0", value_parser = not_negative)]
    machine_sigma_um: f64,
    /// Where the tracker stands in M, its axes parallel to those of M; for angles without --registration.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, conflicts_with = "registration")]
    pub(super) tracker_mm: Option<Vec3>,
}

/// The three columns of a point.
#[derive(Debug, Clone, Copy)]
pub(super) enum PointColumns {
    /// x, y, z.
    Cartesian([Column; 3]),
    /// Range, azimuth, elevation.
    Spherical([Column; 3]),
}

/// A registration with its names.
pub(super) struct Registered {
    fit: RigidFit,
    points: Vec<String>,
    /// True where the noise was stated, so that the residuals are a test.
    stated: bool,
}

/// From the frame of the instrument to M.
pub(super) struct Frame {
    /// Variance of a Cartesian coordinate, mm2.
    cartesian: f64,
    /// Noise of observations; `None` where not stated.
    tracker: Option<TrackerNoise>,
    /// True where the noise was stated.
    pub(super) noise_is_stated: bool,
    station: Vec3,
    pub(super) registered: Option<Registered>,
}

impl PointColumns {
    /// The columns `{prefix}x_mm` and so on, where they are there; refuses a part of them.
    pub(super) fn find(table: &mut Columns, prefix: &str) -> Result<Option<Self>> {
        type Kind = ([&'static str; 3], fn([Column; 3]) -> PointColumns);
        let kinds: [Kind; 2] = [
            (["x_mm", "y_mm", "z_mm"], Self::Cartesian),
            (["range_mm", "azimuth_deg", "elevation_deg"], Self::Spherical),
        ];
        for (names, kind) in kinds {
            let names = names.map(|n| format!("{prefix}{n}"));
            let found = names.each_ref().map(|n| table.find_column(n));
            if let [Some(a), Some(b), Some(c)] = found {
                return Ok(Some(kind([a, b, c])));
            }
            let of = |is_there: bool| {
                let named = names.iter().zip(&found).filter(|(_, column)| column.is_some() == is_there);
                named.map(|(name, _)| name.as_str()).joined(", ")
            };
            if found.iter().any(Option::is_some) {
                return Err(table.fail_row(format_args!(
                    "{} is missing beside {}; a point has all of {}",
                    of(false),
                    of(true),
                    names.join(", ")
                )));
            }
        }
        Ok(None)
    }

    /// The columns of a table that holds one point per row, and no others than those asked for.
    pub(super) fn of_table(table: &mut Columns) -> Result<Self> {
        let found = Self::find(table, "")?.ok_or_else(|| {
            table.fail_row("columns x_mm, y_mm, z_mm (or range_mm, azimuth_deg, elevation_deg) are missing")
        })?;
        table.only_known()?;
        Ok(found)
    }

    /// True where all three fields are empty: the point was not seen.
    pub(super) fn is_empty(self, row: &Columns) -> bool {
        let (Self::Cartesian(columns) | Self::Spherical(columns)) = self;
        columns.iter().all(|c| row.word(*c).is_empty())
    }

    /// Refuses angles where nothing says where the tracker stands.
    pub(super) fn check_frame(self, tracker: &TrackerArgs, frame: &Frame, path: &Path) -> Result<()> {
        if matches!(self, Self::Spherical(_)) && frame.registered.is_none() && tracker.tracker_mm.is_none() {
            return Err(usage!(
                "{}: ranges and angles are in the tracker's frame; give --registration or --tracker-mm",
                path.display()
            ));
        }
        Ok(())
    }
}

impl TrackerArgs {
    /// Noise of range and angles, where both were stated.
    pub(super) fn stated_noise(&self) -> Option<TrackerNoise> {
        Some(TrackerNoise {
            range: mm_from_um(self.sigma_range_um?),
            range_share: self.sigma_range_um_per_m * 1e-6,
            angle: rad_from_arcsec(self.sigma_angle_arcsec?),
        })
    }

    /// The files that the frame is made from.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.registration.iter()
    }

    /// Standard deviation of a Cartesian coordinate as stated, mm.
    pub(super) fn cartesian_sigma(&self) -> Option<f64> {
        self.noise_um.map(mm_from_um)
    }

    /// The frame of --registration, if there is one.
    pub(super) fn frame(&self) -> Result<Frame> {
        self.frame_of(self.registration.as_deref())
    }

    /// The frame of a registration file.
    pub(super) fn frame_of(&self, registration: Option<&Path>) -> Result<Frame> {
        if self.sigma_range_um.is_some() != self.sigma_angle_arcsec.is_some() {
            return Err(usage!("--sigma-range-um and --sigma-angle-arcsec belong together; give both"));
        }
        let tracker = self.stated_noise();
        let mut frame = Frame {
            cartesian: self.cartesian_sigma().unwrap_or(1.0).powi(2),
            tracker,
            noise_is_stated: self.noise_um.is_some() || tracker.is_some(),
            station: self.tracker_mm.unwrap_or_else(Vec3::zeros),
            registered: None,
        };
        frame.registered = registration.map(|path| self.register(path, &frame)).transpose()?;
        Ok(frame)
    }

    fn register(&self, path: &Path, frame: &Frame) -> Result<Registered> {
        let mut table = table::open(path)?;
        let name = table.column("point")?;
        let machine = table.three(["machine_x_mm", "machine_y_mm", "machine_z_mm"])?;
        let columns = PointColumns::of_table(&mut table)?;
        let (mut points, mut from, mut to, mut covariance) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let own = Mat3::identity() * mm_from_um(self.machine_sigma_um).powi(2);
        table.rows(|row| {
            let seen = Place::read(row, columns)?;
            covariance.push(frame.covariance(&seen, row.file())? + own);
            points.push(row.word(name));
            from.push(seen.point());
            to.push(row.point(machine)?);
            Ok(())
        })?;
        // the covariance belongs into M, which the unweighted fit knows well enough
        if let Some((rotation, _)) = procrustes(&from, &to) {
            for c in &mut covariance {
                *c = rotation * *c * rotation.transpose();
            }
        }
        let fit = register(&from, &to, &covariance).map_err(|e| Failure::data(path, e))?;
        Ok(Registered { fit, points, stated: frame.noise_is_stated })
    }
}

impl Frame {
    /// One point of the current row in M, with its covariance.
    pub(super) fn read(&self, row: &Columns, columns: PointColumns) -> Result<(Vec3, Mat3)> {
        let place = Place::read(row, columns)?;
        let covariance = self.covariance(&place, row.file())?;
        let turned = self.registered.as_ref().map_or(covariance, |r| r.fit.turn(&covariance));
        Ok((self.in_machine(&place), turned))
    }

    /// One point of the current row in M, whatever its noise.
    pub(super) fn place(&self, row: &Columns, columns: PointColumns) -> Result<Vec3> {
        Ok(self.in_machine(&Place::read(row, columns)?))
    }

    fn in_machine(&self, place: &Place) -> Vec3 {
        match (&self.registered, place) {
            (Some(r), place) => r.fit.apply(&place.point()),
            (None, Place::Cartesian(point)) => *point,
            (None, Place::Spherical(o)) => o.point() + self.station,
        }
    }

    /// In the frame of the instrument.
    fn covariance(&self, place: &Place, file: &str) -> Result<Mat3> {
        match (place, self.tracker) {
            (Place::Cartesian(_), _) => Ok(Mat3::identity() * self.cartesian),
            (Place::Spherical(o), Some(noise)) => Ok(o.covariance(&noise)),
            (Place::Spherical(_), None) => Err(usage!(
                "{file}: ranges and angles need weights: give --sigma-range-um and --sigma-angle-arcsec"
            )),
        }
    }
}

/// A point as the instrument gave it.
enum Place {
    Cartesian(Vec3),
    Spherical(Observation),
}

impl Place {
    fn read(row: &Columns, columns: PointColumns) -> Result<Self> {
        let at = match columns {
            PointColumns::Cartesian(at) => return row.point(at).map(Self::Cartesian),
            PointColumns::Spherical(at) => at,
        };
        let [range, azimuth, elevation] = row.point(at)?.into();
        if range <= 0.0 {
            return Err(row.fail(at[0], format_args!("range {range} mm is not above 0")));
        }
        let degrees = row.number(at[2])?;
        if degrees.abs() > 89.0 {
            return Err(row.fail(
                at[2],
                format_args!("elevation {degrees} deg is beyond 89 deg, where the azimuth is undefined"),
            ));
        }
        Ok(Self::Spherical(Observation { range, azimuth, elevation }))
    }

    fn point(&self) -> Vec3 {
        match self {
            Self::Cartesian(point) => *point,
            Self::Spherical(o) => o.point(),
        }
    }
}

impl Registered {
    /// Probability of residuals this large, where the noise was stated.
    fn p_value(&self) -> Option<f64> {
        self.fit.test().p_value().filter(|_| self.stated)
    }

    /// Standard deviations: of the centre (mm) and of the three rotations (rad).
    pub(super) fn std(&self) -> [f64; 6] {
        self.fit.std(self.stated)
    }

    /// What the registration does to a point of M: standard deviation of its largest direction, mm.
    pub(super) fn std_at(&self, point: &Vec3) -> f64 {
        self.fit.std_at(point, self.stated)
    }

    pub(super) fn print(&self) {
        let (points, (worst, largest)) = (self.points.len(), self.fit.worst());
        let worst = &self.points[worst];
        let (rms, largest) = (um_from_mm(self.fit.rms()), um_from_mm(largest));
        say_text!(
            "registration from {points} points: residual rms {rms:.2} um, largest {largest:.2} um ({worst})"
        );
        let [x, y, z, a, b, c] = self.std();
        let ([x, y, z], [a, b, c]) = ([x, y, z].map(um_from_mm), [a, b, c].map(arcsec_from_rad));
        say_text!(
            "  uncertainty (k=1): position {x:.2} {y:.2} {z:.2} um, rotation {a:.3} {b:.3} {c:.3} arcsec; a constant and a slope for all positions alike"
        );
        let RigidFit { chi2, dof, .. } = self.fit;
        match self.p_value() {
            Some(p) if p < SIGNIFICANT => note!(
                "warning: registration: the residuals are larger than the stated noise allows (chi2 {chi2:.1}, {dof} degrees of freedom, p {p:.1e}); check reference point {worst}"
            ),
            Some(p) => {
                say!("  residual test passed: chi2 {chi2:.1}, {dof} degrees of freedom, p {p:.3}");
            }
            None => {}
        }
    }

    pub(super) fn json(&self) -> Value {
        let rotation: Value = self.fit.rotation.row_iter().map(|r| json!([r[0], r[1], r[2]])).collect();
        fields!(self.fit; chi2, dof;
            "points": self.points,
            "rotation": rotation,
            "translation": self.fit.translation.as_slice(),
            "residual_rms": self.fit.rms(),
            "worst_point": self.points[self.fit.worst().0],
            "std": self.std(),
            "p_value": self.p_value(),
        )
    }
}
