use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Random scripts: some for the gate; `VOLCOMP_ADVERSARY_SCRIPTS` and `VOLCOMP_ADVERSARY_SEED` choose longer runs.
#[test]
#[expect(clippy::disallowed_methods, reason = "longer runs are chosen by the environment")]
fn no_random_script_breaks_an_invariant() {
    let scripts =
        std::env::var("VOLCOMP_ADVERSARY_SCRIPTS").ok().and_then(|n| n.parse().ok()).unwrap_or(1500);
    let seed = std::env::var("VOLCOMP_ADVERSARY_SEED").ok().and_then(|n| n.parse().ok()).unwrap_or(22);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut cycles, mut answers) = (0, 0);
    for n in 0..scripts {
        let mut bytes = vec![0; rng.random_range(4..160)];
        rng.fill_bytes(&mut bytes);
        let outcome = run(&bytes).expect("a configuration that fits");
        assert!(outcome.is_clean(), "seed {seed}, script {n}: {bytes:?}\n{:?}", outcome.report);
        cycles += outcome.cycles;
        answers += outcome.report.figures.answers;
    }
    assert!(answers > 100 * scripts, "{answers} answers in {cycles} cycles say nothing");
}

/// What the monitor must find: the engine's own limits are twice those that it holds the answers against.
#[test]
fn the_monitor_sees_a_limit_that_is_not_kept() {
    let mut script = Script::new(&[0]);
    let mut world = World::new(&mut script).expect("fits");
    let mut strict = settings(&config(&mut Script::new(&[0])));
    strict.limits[0].size = 0.004;
    world.monitor.set_settings(strict);
    world.carry_out(Operation::Command(Command::Enable));
    world.carry_out(Operation::Cycles { count: 255, speed: 0.0 });
    assert!(!world.monitor.report().is_clean(), "10 um are beyond 4 um");
}

#[test]
fn every_configuration_and_every_model_fits() {
    let models = models();
    assert_eq!(models.len(), 5);
    for choices in 0..=u8::MAX {
        let config = config(&mut Script::new(&[choices]));
        for model in &models {
            if let Err(e) = Compensator::new(&config, model) {
                panic!("{choices}: {e}");
            }
        }
    }
}
