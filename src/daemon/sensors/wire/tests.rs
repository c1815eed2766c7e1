//! Both forms of messages, right and wrong.

use super::*;

/// The next reading.
fn next(stream: &mut Stream) -> Option<Result<Said, WireError>> {
    stream.next().map(|heard| {
        heard.map(|heard| match heard {
            Heard::Reading(said) => said,
            Heard::Sync(number) => panic!("sync {number}"),
        })
    })
}

#[test]
fn a_sync_is_told_from_readings_and_nothing_else_stands_beside_it() {
    let heard = |line: &str| {
        let mut stream = Stream::default();
        stream.push(format!("{line}\n").as_bytes());
        stream.next().unwrap()
    };
    assert_eq!(heard("{\"sync\": 7}"), Ok(Heard::Sync(7)));
    assert!(heard("{\"sync\": -7}").is_err() && heard("{\"sync\": 7, \"sensor\": \"a\"}").is_err());
}

fn one(text: &str) -> Result<Said, WireError> {
    let mut stream = Stream::default();
    stream.push(text.as_bytes());
    stream.push(b"\n");
    next(&mut stream).expect("a message")
}

fn binary(kind: u8, name: &str, numbers: &[f64]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.push(kind);
    bytes.push(u8::try_from(name.len()).unwrap());
    bytes.extend(u16::try_from(numbers.len()).unwrap().to_le_bytes());
    bytes.extend(12_345_678_901_i64.to_le_bytes());
    bytes.extend(0.5_f32.to_le_bytes());
    bytes.extend(name.as_bytes());
    numbers.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    let sum = crc32c::crc32c(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

#[test]
fn json_arrives_in_mm_and_rad() {
    let said = one(
        r#"{"sensor": "t", "t_s": 1.5, "pose": {"tip_deviation_um": [1, 2, 3], "direction": [0, 0, 1]}}"#,
    )
    .unwrap();
    assert_eq!(
        (said.sensor.as_str(), said.reading.stamp_ns, said.reading.quality),
        ("t", 1_500_000_000, 1.0)
    );
    let Body::Tool(tool) = said.reading.body else { panic!("a pose") };
    assert_eq!(tool.tip, Seen::Deviation(Vec3::new(0.001, 0.002, 0.003)));
    assert_eq!(tool.direction, Some(Seen::Absolute(Vec3::z())));
    let said =
        one(r#"{"sensor": "p", "t_ns": 7, "probe": {"direction": [0, 1, 0], "value_um": -4}}"#).unwrap();
    assert_eq!(said.reading.body, Body::Deviation { direction: Vec3::y(), value: -0.004, std: None });
    let circles = r#"{"sensor": "t", "t_ns": 7, "circles": [{"height_mm": 20, "centre_mm": [1, 2, 3]}]}"#;
    let Body::Points(points) = one(circles).unwrap().reading.body else { panic!("points") };
    assert_eq!(points[0].offset, Vec3::new(0.0, 0.0, 20.0));
    let said = one(r#"{"sensor": "a", "t_ns": 7, "temperature_degc": [20.5, 21]}"#).unwrap();
    assert_eq!(said.reading.body, Body::Temperatures(vec![20.5, 21.0]));
    let said = one(r#"{"sensor": "s", "t_ns": 7, "speed_rpm": -3000}"#).unwrap();
    assert_eq!(said.reading.body, Body::Speed(-3000.0));
}

#[test]
fn mistakes_are_told_and_cost_one_line() {
    for (text, words) in [
        (r#"{"sensor": "t", "pose": {"tip_mm": [1, 2, 3]}}"#, "t_s or t_ns"),
        (r#"{"sensor": "t", "t_s": 1}"#, "exactly one of"),
        (r#"{"sensor": "t", "t_s": 1, "value_um": 1, "value_arcsec": 1}"#, "exactly one of"),
        (r#"{"sensor": "t", "t_s": 1, "value_mm": 1}"#, "unknown field"),
        (r#"{"sensor": "t", "t_s": 1, "pose": {}}"#, "either tip_mm"),
        (r#"{"sensor": "t", "t_s": 1, "deviation": {"direction": [1, 1, 0], "value_um": 1}}"#, "unit vector"),
        (r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1, 2, 3], "covariance": [1]}}"#, "36"),
        (r#"{"sensor": "t", "t_s": 1, "value_um": 1, "quality": 1.5}"#, "quality is 1.5, 0 (unusable) to 1"),
        (r#"{"sensor": "t", "t_s": 1, "value_um": 1, "quality": -0.1}"#, "quality is -0.1"),
        (
            r#"{"sensor": "t", "t_s": 1, "probe": {"direction": [0, 1, 0], "value_um": 1, "std_um": -2}}"#,
            "std_um is -2",
        ),
        (
            r#"{"sensor": "t", "t_s": 1, "points": [{"offset_mm": [0, 0, 0], "deviation_um": [1, 2, 3], "std_um": -1}]}"#,
            "std_um is -1",
        ),
        (
            r#"{"sensor": "t", "t_s": 1, "circles": [{"height_mm": 1, "centre_mm": [1, 2, 3], "std_um": -1}]}"#,
            "std_um is -1",
        ),
        (
            r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1, 2, 3], "covariance": [4,0,0,0,0,0, 3,4,0,0,0,0, 0,0,4,0,0,0, 0,0,0,1,0,0, 0,0,0,0,1,0, 0,0,0,0,0,1]}}"#,
            "covariance is not symmetric: row 2, column 1 is 3, and row 1, column 2 is 0",
        ),
        (r#"{"sensor": "t", "t_s": 1, "points": []}"#, "points has 0 entries"),
        (r#"{"sensor": "t", "t_s": 1, "circles": []}"#, "circles has 0 entries"),
        (r#"{"sensor": "t", "t_s": 1, "temperature_degc": []}"#, "1 to 16 are taken"),
        ("nonsense", "line 1: column 2: expected ident, found `nonsense`"),
        (
            r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1, 2, 3, 4]}}"#,
            "line 1: tip_mm has 4 numbers, 3 are needed",
        ),
        (r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1]}}"#, "tip_mm has 1 number, 3 are needed"),
        (
            r#"{"sensor": "t", "t_s": 1, "pose": {"tip_mm": [1, NaN, 3]}}"#,
            "line 1: column 50: expected value, found `NaN`; JSON has finite numbers only",
        ),
        (
            r#"{"sensor": "t", "t_s": 1, "value_um": -Infinity}"#,
            "found `-Infinity`; JSON has finite numbers only",
        ),
        (r#"{"sensor": "t", "t_s": 1, "value_um": 1e999}"#, "number out of range, found `1e999`"),
        (
            r#"{"sensor": "t", "t_s": 1, "deviation": {"direction": [1, 1, 0], "value_um": 1}}"#,
            "direction [1, 1, 0] has the length 1.4142; a unit vector is needed, within 0.001",
        ),
        (
            r#"{"sensor": "t", "t_s": 1, "five_dof_raw": {"distance_mm": 0, "psd1_um": [1, 2], "psd2_um": [1, 2], "psd3_um": [1, 2], "qd1_um": [1, 2], "qd2_um": [1, 2]}}"#,
            "distance_mm is 0 mm; from the head to the carriage it is above 0",
        ),
        (
            r#"{"sensor": "t", "t_s": 1, "five_dof_raw": {"distance_mm": 500, "psd1_um": [1, 2], "psd2_um": [1], "psd3_um": [1, 2], "qd1_um": [1, 2], "qd2_um": [1, 2]}}"#,
            "psd2_um has 1 number, 2 are needed",
        ),
    ] {
        let error = one(text).unwrap_err();
        assert!(error.to_string().contains(words) && !error.is_fatal(), "{text}: {error}");
    }
    let mut stream = Stream::default();
    stream.push(b"nonsense\n\n# a comment\n{\"sensor\": \"v\", \"t_ns\": 1, \"value_um\": 2}\n{\"sen");
    assert!(next(&mut stream).unwrap().is_err());
    assert_eq!(
        next(&mut stream).unwrap().unwrap().reading.body,
        Body::Value { value: 0.002, unit: Some(Kind::Length) }
    );
    assert!(next(&mut stream).is_none());
}

#[test]
fn both_forms_share_a_connection_and_arrive_piece_by_piece() {
    let mut all = binary(8, "v", &[0.002]);
    all.extend(b"{\"sensor\": \"v\", \"t_ns\": 1, \"value_um\": 2}\n");
    let mut raw = vec![500.0];
    raw.extend((0..10).map(f64::from));
    all.extend(binary(7, "laser-x", &raw));
    let mut stream = Stream::default();
    let mut found = Vec::new();
    for byte in all {
        stream.push(&[byte]);
        while let Some(said) = next(&mut stream) {
            found.push(said.unwrap());
        }
    }
    assert_eq!(found.len(), 3);
    assert_eq!(found[0].reading.body, Body::Value { value: 0.002, unit: None });
    assert_eq!(found[1].reading.body, Body::Value { value: 0.002, unit: Some(Kind::Length) });
    assert_eq!((found[0].reading.stamp_ns, found[0].reading.quality), (12_345_678_901, 0.5));
    let Body::FiveDofRaw(readings) = &found[2].reading.body else { panic!("raw") };
    assert_eq!((readings.distance, readings.change[4]), (500.0, [8.0, 9.0]));
}

#[test]
fn every_binary_kind_is_read_and_wrong_ones_are_refused() {
    let one = |bytes: &[u8]| {
        let mut stream = Stream::default();
        stream.push(bytes);
        next(&mut stream).expect("a message")
    };
    let mut pose = vec![1.0, 2.0, 3.0, 0.0, 0.0, 1.0];
    assert!(
        matches!(one(&binary(1, "t", &pose)).unwrap().reading.body, Body::Tool(t) if t.covariance.is_none())
    );
    let refused = |kind: u8, numbers: &[f64], words: &str| {
        let error = one(&binary(kind, "t", numbers)).unwrap_err();
        assert!(!error.is_fatal() && error.to_string().contains(words), "{error}");
    };
    for direction in [[0.0, 0.0, 0.98], [0.0, 0.1, 1.0], [0.0; 3]] {
        pose[3..].copy_from_slice(&direction);
        refused(1, &pose, "unit vector");
    }
    pose[4] = f64::NAN;
    refused(1, &pose, "not finite");
    pose[3..].fill(f64::NAN);
    assert!(
        matches!(one(&binary(2, "t", &pose)).unwrap().reading.body, Body::Tool(t) if t.direction.is_none())
    );
    pose.extend([f64::INFINITY; 36]);
    refused(1, &pose, "not finite");
    refused(9, &[], "it has 0 entries, 1 to 16 are taken");
    refused(6, &[0.0; 4], "it has 4 numbers, 5 are needed");
    refused(8, &[0.0; 2], "it has 2 numbers, 1 is needed");
    refused(1, &[0.0; 7], "it has 7 numbers, 6 or 42 are needed");
    refused(3, &[0.0; 8], "it has 8 numbers, 7 for each of 1 to 500 points");
    refused(6, &[0.0, f64::NAN, 0.0, 0.0, 0.0], "number 2 is NaN");
    refused(11, &[0.0], "this kind is not known, 1 to 10 are");
    for distance in [0.0, -500.0] {
        let mut raw = [1.0; 11];
        raw[0] = distance;
        refused(
            7,
            &raw,
            &format!("the distance is {distance} mm; from the head to the carriage it is above 0"),
        );
    }
    refused(5, &[0.0, 0.0, 1.0, 0.1, -0.1], "standard deviation is -0.1, 0 (not stated) or more");
    refused(3, &[0.0, 0.0, 0.0, 1.0, 2.0, 3.0, -0.1], "standard deviation is -0.1");
    pose[6..].fill(1e-6);
    pose[7] = 2e-6;
    refused(1, &pose, "not symmetric");
    for quality in [-0.1_f32, 1.5, f32::NAN] {
        let mut bytes = binary(8, "t", &[1.0]);
        bytes[16..20].copy_from_slice(&quality.to_le_bytes());
        let end = bytes.len() - 4;
        let sum = crc32c::crc32c(&bytes[..end]);
        bytes[end..].copy_from_slice(&sum.to_le_bytes());
        assert!(one(&bytes).unwrap_err().to_string().contains("0 (unusable) to 1"), "{quality}");
    }
    pose[6..].fill(1e-6);
    assert!(
        matches!(one(&binary(1, "t", &pose)).unwrap().reading.body, Body::Tool(t) if t.covariance.is_some())
    );
    assert!(
        matches!(one(&binary(4, "t", &[0.0; 14])).unwrap().reading.body, Body::Points(p) if p.len() == 2)
    );
    assert!(matches!(one(&binary(6, "t", &[0.0; 5])).unwrap().reading.body, Body::FiveDof(_)));
    assert_eq!(
        one(&binary(9, "t", &[20.5, 21.0])).unwrap().reading.body,
        Body::Temperatures(vec![20.5, 21.0])
    );
    assert_eq!(one(&binary(10, "t", &[3000.0])).unwrap().reading.body, Body::Speed(3000.0));
    for (kind, count) in [(1, 5), (3, 8), (5, 5), (6, 4), (7, 10), (8, 2), (9, 17), (10, 2), (77, 1)] {
        let error = one(&binary(kind, "t", &vec![0.0; count])).unwrap_err();
        assert!(!error.is_fatal(), "{error}");
    }
    assert!(one(&binary(8, "t", &[f64::NAN])).is_err());
    let mut broken = binary(8, "t", &[1.0]);
    broken[22] ^= 1;
    assert!(one(&broken).unwrap_err().is_fatal());
    assert!(one(b"VXXX0000000000000000000000").unwrap_err().is_fatal());
    let mut endless = vec![b'{'; MESSAGE_MAX + 1];
    assert!(one(&endless).unwrap_err().is_fatal());
    endless.push(b'\n');
    assert!(one(&endless).unwrap_err().is_fatal(), "not even where its end has come as well");
}
