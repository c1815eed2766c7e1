//! Files that only the command line reads: tables of readings, sign tables, instrument files, cases, sessions, additions.
//! The first byte chooses the command, the rest is its file. Never a panic, never an exit code that says the program is
//! wrong, and nothing is written where a file is refused.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the target writes the file that the command reads")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

/// `@` is the file, `!` a file to write, the others are made once.
const COMMANDS: [&str; 29] = [
    "fit --errors @ --axis x --order 2 --out !",
    "fit --errors @ --axis c --basis table --out !",
    "evaluate iso230-2 --data @ --report !",
    "evaluate iso230-4 --data @ --report !",
    "evaluate iso230-6 --data @ --report !",
    "evaluate plate --data @ --report !",
    "predict --model model.toml --points @ --out !",
    "import @ --columns target=a:mm,deviation=b:um --out !",
    "identify straightness --data @ --axis x --out !",
    "identify straightness --axis x --tilt-test tilt.csv --signs @ --write-signs !",
    "identify fivedof --axis x --resting rest.csv --calibration @ --write-calibration !",
    "identify diagonals --data @ --box-mm 100,100,100 --accept-bias-arcsec 1 --out !",
    "identify probe --data @ --bar-radius-mm 5 --nominal-mm 0,0 --out !",
    "identify ballbar --data xy=@ --radius-mm 100 --out !",
    "identify nineline --axis x --lines lines.csv --data @ --sigma-um 1 --out !",
    "identify threepoint --axis x --points points.csv --data @ --out !",
    "identify ram --poses @ --a-axis-mm 0,0,-100 --tool-length-mm 100 --sigma-position-um 1 --sigma-direction-arcsec 1 --out !",
    "identify circles --data @ --tip-beyond-mm 50",
    "identify threepoint --json --input @",
    "identify circles --json --input @",
    "identify diagonals --json --input @",
    "identify fivedof --json --input @",
    "identify ram --json --input @",
    "identify kalman --json --input @",
    "predict --model model.toml --points where.csv --add @ --out !",
    "diagnose --model model.toml --data @",
    "diagnose --model model.toml --plan --data @",
    "correct --model model.toml --gcode @ --out !",
    "evaluate gear --data @ --teeth 31 --module-mm 4 --face-width-mm 30 --tip-diameter-mm 132 --control-diameter-mm 118 --report !",
];

/// What the commands need beside the file.
const BESIDE: [(&str, &str); 6] = [
    (
        "model.toml",
        "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z t]\"\n[errors.exx.constant]\nvalue-um = 1\n",
    ),
    (
        "tilt.csv",
        "applied_ea_arcsec,applied_eb_arcsec,applied_ec_arcsec,pitch_arcsec\n9,0,0,0\n-9,0,0,0\n0,9,0,9\n0,-9,0,-9\n0,0,9,0\n0,0,-9,0\n",
    ),
    ("rest.csv", "distance_mm,psd1_y_um\n100,1\n200,2\n"),
    ("lines.csv", "line,x_mm,y_mm,z_mm\n1,0,100,10\n2,0,-100,0\n3,0,0,150\n"),
    (
        "where.csv",
        "t_s,x_mm,y_mm,z_mm,dir_x,dir_y,dir_z,vx_mm_per_s,temp_x_degc\n0,0,0,0,1,1,1,5,20\n1,100,50,20,-1,1,1,-5,21\n",
    ),
    ("points.csv", "point,x_mm,y_mm,z_mm\np,0,0,0\nq,300,0,0\nr,0,300,50\n"),
];

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("volcomp-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    for (name, text) in BESIDE {
        std::fs::write(folder.join(name), text).expect("a file");
    }
    folder
});

fn word(folder: &Path, text: &str) -> std::ffi::OsString {
    let path = |name: &str| folder.join(name).into_os_string();
    match text {
        "@" => path("in"),
        "!" => path("out"),
        _ if BESIDE.iter().any(|(name, _)| *name == text) => path(text),
        _ if text.ends_with("=@") => {
            format!("{}{}", &text[..text.len() - 1], folder.join("in").display()).into()
        }
        _ => text.into(),
    }
}

fuzz_target!(|data: &[u8]| {
    let [choice, rest @ ..] = data else { return };
    let folder = &*FOLDER;
    let out = folder.join("out");
    std::fs::write(folder.join("in"), rest).expect("the input");
    let _ = std::fs::remove_file(&out);
    let command = COMMANDS[usize::from(*choice) % COMMANDS.len()];
    let words = core::iter::once("volcomp").chain(command.split(' ')).map(|w| word(folder, w));
    let code = volcomp::cli::volcomp(words);
    for wrong in [70, 74] {
        assert_ne!(code, ExitCode::from(wrong), "{command}");
    }
    assert!(code == ExitCode::SUCCESS || !out.exists(), "{command} refused the file and wrote one");
});
