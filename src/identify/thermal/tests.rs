use super::*;

/// A spindle that runs and stands: a body of 20 minutes that its speed warms, seen by a sensor, and a room of 24 h.
fn recording(rows: usize) -> (Vec<f64>, Vec<Input>, Vec<f64>) {
    let (mut body, mut slow) = (0.0, 0.0);
    let mut time_s = Vec::new();
    let mut columns = vec![Vec::new(); 3];
    let mut y = Vec::new();
    for k in 0..rows {
        let t = k as f64 * 60.0;
        let speed = [0.0, 2000.0, 4000.0, 1000.0, 5000.0, 3000.0][(k / 120) % 6];
        let room = 21.0 + 1.5 * (t / 86_400.0 * core::f64::consts::TAU).sin();
        body += (12.0 * speed / 5000.0 - body) * (1.0 - (-60.0f64 / 1200.0).exp());
        slow += (body - slow) * (1.0 - (-60.0f64 / 1800.0).exp());
        time_s.push(t);
        columns[0].push(speed);
        columns[1].push(room + body);
        columns[2].push(room);
        y.push(0.0015 * slow + 0.0008 * (room - 21.0));
    }
    let names = [("n", Quantity::Speed), ("t1", Quantity::Temperature), ("t2", Quantity::Temperature)];
    let inputs = names
        .iter()
        .zip(columns)
        .map(|((name, quantity), values)| Input { sensor: (*name).to_owned(), quantity: *quantity, values })
        .collect();
    (time_s, inputs, y)
}

#[test]
fn a_known_machine_is_predicted_better_than_by_plain_regression() {
    let (t, inputs, y) = recording(2400);
    let found = fit(&t, &inputs, &y, &Request::default()).unwrap();
    let forecast = found.forecast.unwrap();
    assert!(forecast.rms < 0.05 * found.raw_rms, "{} of {}", forecast.rms, found.raw_rms);
    assert!(forecast.rms < 0.3 * forecast.by_regression_rms.unwrap(), "{forecast:?}");
    assert!(found.fit_rms < 0.05 * found.raw_rms && forecast.by_mean_rms > 0.5 * found.raw_rms);
    found.thermal.validate().unwrap();
    assert_eq!(found.thermal.std, Some(found.rolling_rms));
    // what is written says the same as the figures
    let mut state = ThermalState::new(&found.thermal);
    let mut left = Vec::new();
    for (k, y) in y.iter().enumerate() {
        let readings: Vec<f64> = found
            .thermal
            .inputs
            .iter()
            .map(|i| inputs.iter().find(|c| c.sensor == i.sensor).unwrap().values[k])
            .collect();
        state.advance(&found.thermal, if k == 0 { 0.0 } else { 60.0 }, &readings);
        left.push(y - state.growth(&found.thermal).value);
    }
    assert!((rms(left.into_iter()) - found.fit_rms).abs() < 1e-9);
}

#[test]
fn the_rows_kept_back_do_not_help_the_forecast() {
    let (t, inputs, mut y) = recording(1200);
    let honest = fit(&t, &inputs, &y, &Request::default()).unwrap();
    let from = honest.training_rows;
    y[from..].iter_mut().for_each(|v| *v += 0.1);
    let spoiled = fit(&t, &inputs, &y, &Request::default()).unwrap();
    assert_eq!(honest.predicted, spoiled.predicted);
    assert!((spoiled.forecast.unwrap().rms - 0.1).abs() < 0.01);
    assert_eq!((honest.lambda, honest.rolling_rms), (spoiled.lambda, spoiled.rolling_rms));
}

#[test]
fn what_cannot_be_learned_is_refused() {
    let (t, inputs, y) = recording(300);
    let of = |r: Result<ThermalFit, ThermalFitError>| r.unwrap_err();
    let request = Request::default();
    assert_eq!(of(fit(&t, &[], &y, &request)), ThermalFitError::NoInput);
    assert_eq!(of(fit(&t, &inputs, &vec![0.5; 300], &request)), ThermalFitError::Flat);
    let still: Vec<Input> = inputs.iter().map(|i| Input { values: vec![20.0; 300], ..i.clone() }).collect();
    assert_eq!(of(fit(&t, &still, &y, &request)), ThermalFitError::NothingChanges);
    assert!(matches!(
        of(fit(&t[..15], &inputs, &y[..15], &request)),
        ThermalFitError::TooFewRows { found: 15, .. }
    ));
    let mut back = t.clone();
    back[7] = back[5];
    assert!(matches!(of(fit(&back, &inputs, &y, &request)), ThermalFitError::Time { row: 8, .. }));
    let many = Request { speed_lags_s: vec![60.0; 300], ..request.clone() };
    assert!(matches!(of(fit(&t, &inputs, &y, &many)), ThermalFitError::TooManyTerms { .. }));
    let out = Request { hold_out: 0.9, ..request };
    assert!(matches!(of(fit(&t, &inputs, &y, &out)), ThermalFitError::HoldOut { .. }));
}

#[test]
fn a_sensor_that_never_moves_is_named_and_left_out() {
    let (t, mut inputs, y) = recording(600);
    inputs.push(Input { sensor: "dead".into(), quantity: Quantity::Temperature, values: vec![22.0; 600] });
    let found = fit(&t, &inputs, &y, &Request::default()).unwrap();
    assert_eq!(found.constant, ["dead"]);
    assert!(found.thermal.inputs.iter().all(|i| i.sensor != "dead"));
}
