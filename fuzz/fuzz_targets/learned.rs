//! A `live.json` that another wrote: what is believed is finite, what is not leaves the maps as good as before.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use libfuzzer_sys::fuzz_target;
use volcomp::daemon::sensors::restore_text;
use volcomp::estimate::live::{LiveEstimator, LiveModel, LiveSpec, MapSpec};
use volcomp::model::curve::Live;
use volcomp::model::{Chain, ErrorFunction, ErrorSymbol, Model, ModelSpec};

/// Components of the map, and how far any of them may be from the offline map, mm or rad: far beyond its limit.
const COMPONENTS: usize = 6;
const FAR: f64 = 1.0;

fuzz_target!(|data: &[u8]| {
    let mut estimator = estimator();
    let now = SystemTime::UNIX_EPOCH + Duration::from_secs(2_000_000_000);
    let told = restore_text(data, "m", "abc", &mut estimator, now);
    assert!(!told.unwrap_or_else(|why| why).is_empty());
    for component in 0..COMPONENTS {
        for place in [[0.0; 3], [0.5; 3], [1.0, 0.0, 2.0]] {
            let Some([value, std, used]) = estimator.estimate(0, component, place) else { continue };
            assert!(value.is_finite() && std.is_finite() && std >= 0.0, "{value} {std}");
            assert!(used.abs() <= FAR, "{used}");
        }
    }
});

fn estimator() -> LiveEstimator {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").expect("a chain"));
    let live = vec![Live { sensor: "ram.eaz".to_owned(), limit: 1e-4, reference: None }];
    let function = ErrorFunction { live, ..ErrorFunction::default() };
    spec.errors.push((ErrorSymbol::parse("eaz").expect("a symbol"), function));
    let nodes = [vec![0.0, 1.0], vec![0.0, 1.0], vec![0.0, 1.0]];
    let live = LiveSpec { sensors: Vec::new(), maps: vec![MapSpec::new("ram", nodes)] };
    let model = Arc::new(Model::new(&spec).expect("a model"));
    LiveEstimator::new(&live, LiveModel { spec: &spec, thermal: &[], model, hash: [3; 32] })
        .expect("an estimator")
}
