//! The sets of real data that the build has seen are those that are present: none is ignored without reason.

use std::path::Path;

#[test]
fn the_build_has_seen_every_data_set_that_is_present() {
    for (set, seen) in [
        ("cnc_drilled_plates", cfg!(data_cnc_drilled_plates)),
        ("iso230_2_linear_axes", cfg!(data_iso230_2_linear_axes)),
        ("laser_tracker_3smr_robot", cfg!(data_laser_tracker_3smr_robot)),
        ("real_sessions", cfg!(data_real_sessions)),
        ("sinumerik_edge_capture", cfg!(data_sinumerik_edge_capture)),
    ] {
        let folder = Path::new(env!("VOLCOMP_DATA_FOLDER")).join(set);
        let present = folder.is_dir();
        assert_eq!(seen, present, "{}: touch build.rs, so that the build looks again", folder.display());
    }
}
