//! Numbers: reference vectors, certified data, fits, identification, properties of the model.

mod fit_drift;
mod fit_real_axis;
mod fit_thermal;
mod fit_truth;
mod fit_vectors;
mod gauge;
mod identify_diagonals;
mod identify_fits;
mod identify_fivedof;
mod identify_kalman;
mod identify_probes;
mod identify_straightness;
mod identify_tracker;
mod model_properties;
mod random_machine;
mod vectors_kinematics;
