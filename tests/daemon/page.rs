//! The page in a real browser: what an operator sees of a running machine, a fault, and a restart of the daemon.
//!
//! `VOLCOMP_PICTURES=docs/images cargo test --test daemon page::` writes the pictures of docs/monitoring.md.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use volcomp::protocol::Message;

use crate::browser::Browser;
use crate::http::served;
use crate::support::{Port, Session, Setup};

/// Patience with a change on the page.
const PATIENCE: Duration = Duration::from_secs(30);

/// A model with something to see.
const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test-mill"
chain = "[w X' b Y Z t]"
[errors.exx.table]
position-mm = [-200, -100, 0, 100, 200]
value-um = [-38, -15, 6, 22, 41]
[errors.eyy.table]
position-mm = [-200, 0, 200]
value-um = [-12, 3, 19]
[errors.ezz.table]
position-mm = [-200, 0, 200]
value-um = [21, 3, -16]
[errors.eyx.constant]
value-um = 4.0
[errors.eax.constant]
value-arcsec = 1.0
[errors.ec0y.constant]
value-arcsec = 6.0
[provenance]
expiry = "2099-01-31"
"#;

/// A control that moves, and the page beside it.
struct Scene {
    session: Option<Session>,
    browser: Browser,
    turn: f64,
}

impl Scene {
    /// Some cycles on a circle.
    fn work(&mut self) {
        let Some(session) = &mut self.session else { return std::thread::sleep(Duration::from_millis(20)) };
        for _ in 0..40 {
            self.turn += 2e-4;
            session.commanded[..3].copy_from_slice(&[
                150.0 * self.turn.cos(),
                150.0 * self.turn.sin(),
                60.0 * (0.4 * self.turn).sin(),
            ]);
            // what the daemon closes the test sees on the page
            if !matches!(session.try_cycle(), Message::Correction(_)) {
                self.session = None;
                return;
            }
        }
    }

    /// Works until an expression on the page is true.
    fn until(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        while self.browser.value(expression) != true {
            if Instant::now() > deadline {
                let page = self.browser.value("document.body ? document.body.innerText : ''");
                panic!("never {expression}:\n{}", page.as_str().unwrap_or_default());
            }
            self.work();
        }
    }

    fn work_for(&mut self, time: Duration) {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.work();
        }
    }

    fn picture(&mut self, name: &str) {
        if let Some(folder) = std::env::var_os("VOLCOMP_PICTURES") {
            self.browser.picture(&PathBuf::from(folder).join(name));
        }
    }
}

/// The text of the element with an id.
fn text(id: &str) -> String {
    format!("document.getElementById('{id}').textContent")
}

#[test]
#[cfg_attr(not(tool_chromium), ignore = "needs chromium")]
fn the_page_shows_compensation_a_fault_and_the_recovery_after_a_restart() {
    let port = Port::open();
    let setup = Setup { model: MODEL.to_owned(), ..Setup::default() };
    let (mut daemon, address) = served(&port, setup);
    let mut scene = Scene { session: None, browser: Browser::start(), turn: 0.0 };
    scene.browser.look_like(1280, 900, "light");
    scene.browser.open(&format!("http://{address}/"));
    scene.until("document.readyState === 'complete' && document.getElementById('footer') !== null");
    scene.until(&format!("{} === 'DISCONNECTED'", text("state")));
    scene.session = Some(port.link());
    scene.until(&format!("{} === 'COMPENSATING'", text("state")));
    scene.until(&format!("document.title.startsWith('COMPENSATING') && {}.startsWith('0.') ", text("with")));
    assert_eq!(scene.browser.value("document.getElementById('banner').className"), "active");
    for (id, words) in [
        ("machine", "test-mill"),
        ("model", "6 of 21 error motions"),
        ("model", "2099-01-31"),
        ("axis-list", "limit 150"),
        ("link-rows", "late cycles"),
        ("sensors", "No sensors"),
        ("announce", "COMPENSATING"),
    ] {
        let shown = scene.browser.value(&text(id));
        assert!(shown.as_str().is_some_and(|shown| shown.contains(words)), "{id}: no {words} in {shown}");
    }
    assert_eq!(scene.browser.value("document.querySelectorAll('#axis-list canvas').length"), 3);
    // something is drawn: not every pixel is the same
    let drawn = "(() => { const c = document.querySelector('#axis-x canvas'); \
        return new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size > 8; })()";
    scene.until(drawn);
    if std::env::var_os("VOLCOMP_PICTURES").is_some() {
        scene.work_for(Duration::from_secs(45));
    }
    for (width, height, colours, name) in
        [(1280, 900, "light", "page.png"), (390, 844, "dark", "page-phone.png")]
    {
        scene.browser.look_like(width, height, colours);
        scene.work_for(Duration::from_millis(1200));
        assert_eq!(
            scene.browser.value(&format!("document.documentElement.scrollWidth <= {width}")),
            true,
            "the page is wider than {width}"
        );
        scene.picture(name);
    }
    scene.browser.look_like(1280, 900, "light");
    assert_eq!(scene.browser.take_errors(), Vec::<String>::new());

    // the control holds an offset that was never sent
    scene.session.take().expect("linked").deceive(0.05);
    scene.until(&format!("{} === 'FAULT' && {}.includes('VC-4001')", text("state"), text("cause")));
    assert_eq!(scene.browser.value("document.getElementById('banner').className"), "bad");
    scene.until(&format!("{}.length > 20", text("remedy")));
    let opened = "(() => { const d = [...document.querySelectorAll('#events details')].find((d) => \
        d.textContent.includes('VC-4001')); d.querySelector('summary').click(); return d.open && \
        d.textContent.includes('remedy'); })()";
    assert_eq!(scene.browser.value(opened), true, "an event opens its explanation");
    scene.work_for(Duration::from_millis(1500));
    scene.picture("page-fault.png");
    assert_eq!(
        scene.browser.value("document.querySelectorAll('#events details[open]').length"),
        1,
        "it stays open over updates"
    );
    assert_eq!(scene.browser.take_errors(), Vec::<String>::new());

    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    scene.until(&format!("{} === 'NO DATA' && !document.getElementById('offline').hidden", text("state")));
    // attempts of the killed daemon to connect are still waiting there
    while port.accept_within(Duration::from_millis(100)).is_some() {}
    daemon.restart();
    scene.session = Some(port.link());
    scene
        .until(&format!("{} === 'COMPENSATING' && document.getElementById('offline').hidden", text("state")));
    // the browser itself reports that nobody answered, and nothing else
    for error in scene.browser.take_errors() {
        assert!(error.contains("net::ERR_"), "{error}");
    }
    let here = format!("http://{address}/");
    let elsewhere: Vec<_> = scene.browser.requests().iter().filter(|url| !url.starts_with(&here)).collect();
    assert!(elsewhere.iter().all(|url| url.starts_with("about:")), "{elsewhere:?}");
    assert!(scene.browser.requests().len() > 5);
}
