//! The page in a real browser: what an operator sees of a running machine, a fault, and a restart of the daemon.
//!
//! `VOLCOMP_PICTURES=docs/images cargo test --test daemon page::` writes the pictures of docs/how-to/monitoring.md.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use volcomp::protocol::Message;

use crate::browser::Browser;
use crate::commands::{KEPT, TOKEN, token_file};
use crate::http::{served_with, verify};
use crate::support::{Daemon, Port, Session, Setup};

/// Patience with a change on the page.
const PATIENCE: Duration = Duration::from_secs(30);

/// A model with something to see.
const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test-mill"
chain = "[w X' b Y Z t]"
[axes.x]
travel-mm = [-200, 200]
[axes.y]
travel-mm = [-200, 200]
[axes.z]
travel-mm = [-200, 200]
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
date = 2026-04-12
instrument = "laser interferometer no. 4711"
expiry = "2099-01-31"
"#;

/// A control on a circle, on a thread of its own: a browser that takes its time must not keep it waiting.
struct Control {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Session>,
}

impl Control {
    fn start(mut session: Session) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut turn: f64 = 0.0;
            let (begun, first_ns) = (Instant::now(), session.control_ns);
            // what the daemon closes the test sees on the page
            while !stopped.load(Relaxed) {
                session.commanded[..3].copy_from_slice(&[
                    150.0 * turn.cos(),
                    150.0 * turn.sin(),
                    60.0 * (0.4 * turn).sin(),
                ]);
                if !matches!(session.try_cycle(), Message::Correction(_)) {
                    break;
                }
                turn += 2e-4;
                // its clock goes as that of this computer does, so that ages mean something
                let elapsed_ns = i64::try_from(begun.elapsed().as_nanos()).expect("fits");
                session.control_ns = session.control_ns.max(first_ns + elapsed_ns);
                std::thread::sleep(Duration::from_millis(1));
            }
            session
        });
        Self { stop, thread }
    }

    fn stop(self) -> Session {
        self.stop.store(true, Relaxed);
        self.thread.join().expect("the control works")
    }
}

/// A control that moves, and the page beside it.
struct Scene {
    control: Option<Control>,
    browser: Browser,
}

impl Scene {
    /// Waits until an expression on the page is true.
    fn until(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        while self.browser.value(expression) != true {
            if Instant::now() > deadline {
                let page = self.browser.value("document.body ? document.body.innerText : ''");
                panic!("never {expression}:\n{}", page.as_str().unwrap_or_default());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Gives a command with the keyboard alone: the button, what its dialog asks for, Enter.
    fn order(&mut self, command: &str, fields: &[(&str, &str)]) {
        self.open(command);
        for (field, text) in fields {
            self.browser.value(&format!(
                "(() => {{ const f = document.getElementById('{field}'); f.focus(); f.select(); }})()"
            ));
            self.browser.write(text);
        }
        self.browser.press("Enter");
        self.until("!document.getElementById('dialog').open");
        self.until(&format!("{}.includes('done')", text("done")));
        let focus = "document.activeElement.dataset.command";
        assert_eq!(self.browser.value(focus), command, "the focus is back where it was");
    }

    fn open(&mut self, command: &str) {
        let button = format!("document.querySelector('[data-command={command}]')");
        self.until(&format!("{button}.getAttribute('aria-disabled') === 'false'"));
        self.browser.value(&format!("{button}.focus()"));
        self.browser.press("Enter");
        self.until("document.getElementById('dialog').open");
    }

    fn picture(&mut self, name: &str) {
        if let Some(folder) = std::env::var_os("VOLCOMP_PICTURES") {
            // a dialog covers what is seen without scrolling
            let whole = self.browser.value("!document.getElementById('dialog').open") == true;
            self.browser.picture(&PathBuf::from(folder).join(name), whole);
        }
    }
}

/// The text of the element with an id.
fn text(id: &str) -> String {
    format!("document.getElementById('{id}').textContent")
}

/// A link on a connection that the daemon has not given up while the browser took its time.
fn fresh_link(port: &Port) -> Session {
    port.close_pending();
    port.link()
}

/// A control on a circle, and a page that was unlocked with the token.
fn unlocked(port: &Port, more_keys: &str) -> (Daemon, Scene, String) {
    let (folder, key) = token_file();
    let setup = Setup {
        model: MODEL.to_owned(),
        start: "on-command",
        silence_s: 30.0,
        more: KEPT,
        ..Setup::default()
    };
    let (daemon, address) = served_with(port, setup, &format!("{key}{more_keys}"));
    // the token is read at every start
    let _kept = folder.keep();
    let mut scene = Scene { control: None, browser: Browser::start() };
    scene.browser.look_like(1440, 900, "light");
    let here = format!("http://{address}/");
    scene.browser.open(&here);
    scene.until("document.readyState === 'complete' && document.getElementById('footer') !== null");
    scene.until(&format!("{} === 'DISCONNECTED'", text("state")));
    scene.control = Some(Control::start(fresh_link(port)));
    scene.until(&format!("{} === 'OFF'", text("state")));
    scene.until(&format!("{}.startsWith('Compensation is off')", text("remedy")));
    scene.browser.value("document.getElementById('token').focus()");
    scene.browser.write(TOKEN);
    scene.browser.press("Enter");
    scene.until(&format!("{} === 'Unlocked.' && document.getElementById('unlock').hidden", text("done")));
    (daemon, scene, here)
}

/// What a screen reader meets has a name, and what the page is for is among it.
fn everything_is_named(browser: &mut Browser, present: &[(&str, &str)]) {
    let spoken = browser.spoken();
    for (role, name) in &spoken {
        let needs = ["button", "textbox", "image", "img", "meter", "link", "region", "dialog", "spinbutton"];
        assert!(
            !needs.contains(&role.as_str()) || !name.trim().is_empty(),
            "a {role} without a name: {spoken:?}"
        );
    }
    for &(role, name) in present {
        assert!(spoken.iter().any(|(r, n)| r == role && n.starts_with(name)), "no {role} {name}: {spoken:?}");
    }
}

#[test]
#[cfg_attr(not(tool_chromium), ignore = "needs chromium")]
fn the_page_enables_shows_a_fault_clears_it_and_recovers_after_a_restart() {
    let port = Port::open();
    let folder = tempfile::tempdir().expect("directory");
    let record = folder.path().join("verification.json");
    let (mut daemon, mut scene, here) =
        unlocked(&port, &format!("verification = \"{}\"\n", record.display()));
    scene.order("enable", &[("name", "A. Smith"), ("reason", "warm-up done")]);
    scene.until(&format!("{} === 'COMPENSATING'", text("state")));
    scene.until(&format!("document.title.startsWith('COMPENSATING') && {}.startsWith('0.') ", text("with")));
    // amber where the host was late, with the number of the warning; green otherwise
    // read in one go: a warning may end between two calls
    let banner =
        scene.browser.value(&format!("[document.getElementById('banner').className, {}]", text("cause")));
    let warns = banner[0] == "held" && banner[1].as_str().is_some_and(|cause| cause.contains("VC-"));
    assert!(banner[0] == "active" || warns, "{banner}");
    scene.until(&format!("{}.includes('Tool at X')", text("volume-note")));
    for (id, words) in [
        ("machine", "test-mill"),
        ("since", "since "),
        ("model", "6 of 21 error motions"),
        ("model", "2099-01-31"),
        ("model", "2026-04-12, laser interferometer no. 4711"),
        ("axis-list", "limit 150"),
        ("link-rows", "late cycles"),
        ("sensors", "No sensors"),
        ("announce", "COMPENSATING"),
        ("volume-note", "magnified"),
    ] {
        // a host that was late for a moment makes the page announce that first
        scene.until(&format!("{}.includes('{words}')", text(id)));
    }
    assert_eq!(scene.browser.value("document.querySelectorAll('#axis-list canvas').length"), 3);
    // something is drawn: not every pixel is the same
    let drawn = "(() => { const c = document.querySelector('#axis-x canvas'); \
        return new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size > 8; })()";
    scene.until(drawn);
    assert!(
        scene.browser.value("document.querySelectorAll('#volume path.front').length").as_u64() > Some(20)
    );
    assert_eq!(scene.browser.value("document.querySelectorAll('#tool circle').length"), 2);
    let present =
        [("button", "Enable"), ("button", "Disable"), ("meter", "Axis X"), ("heading", "Volume, distorted")];
    everything_is_named(&mut scene.browser, &present);
    // the last verification comes from a file that may be written while the daemon runs
    verify(&record, "2026-05-03", &daemon.dir.path().join("model.toml"));
    scene.until(&format!("{}.includes('2026-05-03')", text("verification")));
    for words in ["laser interferometer no. 4711", "X axis, ISO 230-2", " % less"] {
        let shown = scene.browser.value(&text("verification"));
        assert!(shown.as_str().is_some_and(|shown| shown.contains(words)), "no {words} in {shown}");
    }
    assert_eq!(scene.browser.value(&text("verification-note")), "Verified with the model in use.");
    if std::env::var_os("VOLCOMP_PICTURES").is_some() {
        std::thread::sleep(Duration::from_secs(40));
    }
    for (width, height, colours, name) in [
        (1440, 900, "light", "page.png"),
        (1440, 900, "dark", "page-dark.png"),
        (390, 844, "light", "page-phone.png"),
        (390, 844, "dark", "page-phone-dark.png"),
    ] {
        scene.browser.look_like(width, height, colours);
        std::thread::sleep(Duration::from_millis(1500));
        assert_eq!(
            scene.browser.value(&format!("document.documentElement.scrollWidth <= {width}")),
            true,
            "the page is wider than {width}"
        );
        // as a note about a map that is kept under a long path
        let note = format!(
            "(() => {{ const note = document.createElement('p'); note.textContent = '/' + 'x'.repeat(200); \
             document.getElementById('sensors').append(note); \
             const fits = document.documentElement.scrollWidth <= {width}; note.remove(); return fits; }})()"
        );
        assert_eq!(scene.browser.value(&note), true, "a long word makes the page wider than {width}");
        scene.picture(name);
    }
    scene.browser.look_like(1440, 900, "light");
    assert_eq!(scene.browser.take_errors(), Vec::<String>::new());

    // the control holds an offset that was never sent
    let mut session = scene.control.take().expect("linked").stop();
    // a frame that came late makes the engine follow the read-back until ten came in time, and this is about the others
    for _ in 0..50 {
        let _ = session.cycle();
    }
    session.deceive(0.05);
    scene.until(&format!("{} === 'FAULT' && {}.includes('VC-4001')", text("state"), text("cause")));
    assert_eq!(scene.browser.value("document.getElementById('banner').className"), "bad");
    scene.until(&format!(
        "{}.length > 20 && {}.includes('compensation ends')",
        text("remedy"),
        text("reaction")
    ));
    scene.until("document.getElementById('events').textContent.includes('VC-4001')");
    let opened = "(() => { const d = [...document.querySelectorAll('#events details')].find((d) => \
        d.textContent.includes('VC-4001')); d.querySelector('summary').click(); return d.open && \
        d.textContent.includes('remedy'); })()";
    assert_eq!(scene.browser.value(opened), true, "an event opens its explanation");
    std::thread::sleep(Duration::from_millis(1500));
    scene.picture("page-fault.png");
    assert_eq!(
        scene.browser.value("document.querySelectorAll('#events details[open]').length"),
        1,
        "it stays open over updates"
    );
    assert_eq!(scene.browser.take_errors(), Vec::<String>::new());

    // its cause is gone: the fault is cleared on the page, and compensation comes back
    let mut session = fresh_link(&port);
    session.run_unanswered(50);
    scene.order("clear-fault", &[("reason", "second daemon removed")]);
    scene.control = Some(Control::start(session));
    scene.order("enable", &[("reason", "go on")]);
    scene.until(&format!("{} === 'COMPENSATING'", text("state")));
    let audit = std::fs::read_to_string(daemon.dir.path().join("state/audit.jsonl")).expect("an audit log");
    for word in ["A. Smith (HTTP, 127.0.0.1)", "warm-up done", "second daemon removed"] {
        assert!(audit.contains(word), "no {word} in {audit}");
    }
    assert_eq!(scene.browser.take_errors(), Vec::<String>::new());

    // a link that breaks: the banner alone says what the offset does, and what to do
    drop(scene.control.take().map(Control::stop));
    let says = |id: &str, word: &str| format!("{}.includes('{word}')", text(id));
    scene.until(&format!("{} === 'DISCONNECTED' && {}", text("state"), says("cause", "VC-600")));
    scene.until(&format!("{} && {}", says("reaction", "offset"), says("remedy", "control")));
    scene.picture("page-link.png");
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    scene.until(&format!("{} === 'NO DATA' && !document.getElementById('offline').hidden", text("state")));
    // attempts of the killed daemon to connect are still waiting there
    port.close_pending();
    daemon.restart();
    scene.control = Some(Control::start(fresh_link(&port)));
    scene.until(&format!("{} === 'OFF' && document.getElementById('offline').hidden", text("state")));
    // the tab still has the token
    scene.order("enable", &[("reason", "after the restart")]);
    scene.until(&format!("{} === 'COMPENSATING'", text("state")));
    // the browser itself reports that nobody answered, and nothing else
    for error in scene.browser.take_errors() {
        assert!(error.contains("net::ERR_"), "{error}");
    }
    scene.browser.value("document.getElementById('lock').click()");
    assert_eq!(scene.browser.value("sessionStorage.getItem('volcomp-token')"), serde_json::Value::Null);
    assert_eq!(scene.browser.value("document.cookie + localStorage.length"), "0");
    let elsewhere: Vec<_> = scene.browser.requests().iter().filter(|url| !url.starts_with(&here)).collect();
    assert!(elsewhere.iter().all(|url| url.starts_with("about:")), "{elsewhere:?}");
    assert!(scene.browser.requests().iter().all(|url| !url.contains(TOKEN)), "the token is in no address");
    assert!(scene.browser.requests().len() > 10);
}

#[test]
#[cfg_attr(not(tool_chromium), ignore = "needs chromium")]
fn a_model_is_loaded_behind_a_picture_of_the_difference_and_rolled_back() {
    let port = Port::open();
    let (daemon, mut scene, _) = unlocked(&port, "");
    let first = daemon.status()["model_hash"].clone();
    let write = |name: &str, text: &str| {
        let path = daemon.dir.path().join(name);
        std::fs::write(&path, text).expect("written");
        path
    };
    let new = write("survey-may.toml", &MODEL.replace("22, 41]", "25, 44]").replace("3, 19]", "5, 14]"));
    let large = write("other-screw.toml", &MODEL.replace("22, 41]", "22, 141]"));
    scene.open("load");
    scene.browser.choose("file", &large);
    scene.until(&format!("{}.includes('the limit is 50.0 µm')", text("confirm-text")));
    // without a name it is not sent
    scene.browser.value("document.getElementById('reason').focus()");
    scene.browser.write("new ball screw");
    scene.browser.press("Enter");
    scene.until(&format!("{}.includes('needs the name')", text("problem")));
    assert_eq!(scene.browser.value("document.activeElement.id"), "name");
    assert_eq!(daemon.status()["model_hash"], first);
    // Escape closes the dialog, nothing has changed
    scene.browser.press("Escape");
    scene.until("!document.getElementById('dialog').open");

    scene.open("load");
    scene.browser.choose("file", &new);
    scene.until("document.querySelectorAll('#difference svg').length === 2");
    for words in ["survey-may.toml", "EXX", "EYY", "in the working volume: "] {
        let shown = scene.browser.value(&text("difference"));
        assert!(shown.as_str().is_some_and(|shown| shown.contains(words)), "no {words} in {shown}");
    }
    let present = [("button", "Load"), ("textbox", "Reason"), ("image", "EXX: largest difference 3.00")];
    everything_is_named(&mut scene.browser, &present);
    scene.browser.value("document.getElementById('name').focus()");
    scene.browser.write("A. Smith");
    scene.browser.value("document.getElementById('reason').focus()");
    scene.browser.write("survey of 3 May");
    scene.picture("page-load.png");
    scene.browser.press("Enter");
    scene.until(&format!("{}.includes('Load a model: done')", text("done")));
    let status = daemon.status();
    assert!(status["model_hash"] != first && status["model_choice"]["why"] == "survey of 3 May", "{status}");
    scene.until(&format!("{}.includes('survey-may.toml')", text("model")));

    scene.open("rollback");
    scene.until("document.querySelectorAll('#difference svg').length === 2");
    scene.browser.value("document.getElementById('reason').focus()");
    scene.browser.write("parts got worse");
    scene.browser.press("Enter");
    scene.until(&format!("{}.includes('model before: done')", text("done")));
    assert_eq!(daemon.status()["model_hash"], first);
    assert_eq!(scene.browser.take_errors(), Vec::<String>::new());
}
