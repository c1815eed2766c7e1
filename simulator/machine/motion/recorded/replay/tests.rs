use super::*;

fn axes() -> MachineAxes {
    MachineAxes::three_axis([0.0, 850.0], [0.0, 500.0], [-500.0, 0.0]).unwrap()
}

fn all(cycle_s: f64) -> Vec<MotionCycle> {
    let mut replay = Replay::shipped(&axes(), cycle_s).unwrap();
    core::iter::from_fn(|| replay.next_cycle()).collect()
}

fn description() -> Description {
    Description::from_toml(crate::motion::recorded::SHIPPED_DESCRIPTION).unwrap()
}

#[test]
fn at_its_own_cycle_every_sample_is_exact() {
    let cycles = all(0.002);
    let parts = read_parts(crate::motion::recorded::SHIPPED_DATA, &description(), &axes(), [0.0; 8]).unwrap();
    assert_eq!(parts.iter().map(|p| p.rows.len()).collect::<Vec<_>>(), [1494, 2324]);
    let rows: Vec<&Row> = parts.iter().flat_map(|p| &p.rows).collect();
    let scored: Vec<&MotionCycle> = cycles.iter().filter(|c| c.scored).collect();
    assert_eq!(scored.len(), rows.len());
    for (cycle, row) in scored.iter().zip(rows) {
        assert_eq!(cycle.commanded, row.commanded);
        assert_eq!(cycle.measured.unwrap(), row.actual);
        assert_eq!(cycle.line, row.line);
    }
}

#[test]
fn nothing_is_differentiated_across_the_gap() {
    // 45 mm in one sample would be 22 m/s; the recording itself never exceeds 0.4 m/s on one axis
    for cycle_s in [0.00025, 0.001, 0.002, 0.003, 0.010] {
        let cycles = all(cycle_s);
        for pair in cycles.windows(2) {
            for k in 0..3 {
                let v = (pair[1].commanded[k] - pair[0].commanded[k]).abs() / cycle_s;
                assert!(v <= 402.0, "axis {k}: {v} mm/s at line {} ({cycle_s} s)", pair[0].line);
                let (a, b) = (pair[0].measured.unwrap()[k], pair[1].measured.unwrap()[k]);
                assert!((b - a).abs() / cycle_s <= 420.0, "actual, axis {k}, line {}", pair[0].line);
            }
            assert!(pair[0].feed_mm_per_min <= 480.0 * 60.0);
        }
        // the inserted move is there, in one piece, marked, and slow
        let inserted: Vec<usize> =
            cycles.iter().enumerate().filter(|(_, c)| !c.scored).map(|(i, _)| i).collect();
        assert!(inserted.len() as f64 * cycle_s > 0.3);
        assert_eq!(inserted.last().unwrap() - inserted[0] + 1, inserted.len());
        assert!(inserted.iter().all(|&i| cycles[i].feed_mm_per_min <= 175.0 * 60.0));
    }
}

#[test]
fn the_connecting_move_is_smooth_at_both_ends() {
    let cycle_s = 0.001;
    let cycles = all(cycle_s);
    let first = cycles.iter().position(|c| !c.scored).unwrap();
    let last = cycles.iter().rposition(|c| !c.scored).unwrap();
    for joint in [first, last + 1] {
        for k in 0..3 {
            let p = |i: usize| cycles[i].commanded[k];
            let a = (p(joint + 1) - 2.0 * p(joint) + p(joint - 1)) / (cycle_s * cycle_s);
            assert!(a.abs() < 600.0, "axis {k}: {a} mm/s^2");
        }
    }
}

#[test]
fn everything_lies_within_the_travel_of_the_machine() {
    for c in all(0.001) {
        assert_eq!(axes().outside(&c.commanded), None);
    }
}

#[test]
fn resampling_meets_the_samples_it_shares() {
    let coarse = all(0.002);
    let fine = all(0.001);
    for k in 0..1490 {
        assert_eq!(coarse[k].commanded, fine[2 * k].commanded, "{k}");
    }
    // between the samples a cubic stays close to the chord
    for k in 0..1490 {
        let middle = 0.5 * (coarse[k].commanded[0] + coarse[k + 1].commanded[0]);
        assert!((fine[2 * k + 1].commanded[0] - middle).abs() < 0.02);
    }
}

#[test]
fn a_second_run_is_the_same() {
    let mut replay = Replay::shipped(&axes(), 0.002).unwrap();
    let first: Vec<MotionCycle> = core::iter::from_fn(|| replay.next_cycle()).collect();
    replay.rewind();
    assert_eq!(first[0].commanded, replay.start());
    let second: Vec<MotionCycle> = core::iter::from_fn(|| replay.next_cycle()).collect();
    assert_eq!(first, second);
}

#[test]
fn bad_recordings_say_where() {
    let head = "CYCLE,DES_POS|1,ENC_POS|1,DES_POS|2,ENC_POS|2,DES_POS|6,ENC_POS|6\n";
    let read = |rows: &str| {
        read_parts(&format!("{head}{rows}"), &description(), &axes(), [0.0; 8]).unwrap_err().to_string()
    };
    assert!(read("1,0,0,500,500,55,55\n2,0,x,500,500,55,55\n").contains("line 3, column \"ENC_POS|1\""));
    assert!(read("1,0,0,500,500,55,55\n1,0,0,500,500,55,55\n").contains("line 3: time"));
    assert!(read("1,0,0,500,500,55,55\n9,0,0,500,500,55,55\n").contains("fewer than two rows"));
    assert!(read("").contains("fewer than two rows"));
    assert!(read("1,0,0,1200,500,55,55\n2,0,0,500,500,55,55\n").contains("axis X is at 945"));
    let missing = read_parts("CYCLE,A\n1,2\n", &description(), &axes(), [0.0; 8]).unwrap_err().to_string();
    assert!(missing.contains("DES_POS|2"), "{missing}");
}
