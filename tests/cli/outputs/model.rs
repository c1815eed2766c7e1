//! `volcomp model`, `volcomp check`, `volcomp diff`.

use super::each;

const TEXT_JSON: [(&str, &str); 2] = [("", ""), ("-json", "--json")];
const TEXT_JSON_PAGE: [(&str, &str); 3] =
    [("", ""), ("-json", "--json"), ("-page", "--html SCRATCH/page.html --svg SCRATCH/picture.svg")];
const VMC: &str = "config/examples/vmc-850/model.toml";

#[test]
fn show() {
    each("model-show", "model show DATA/model-full.toml", &TEXT_JSON_PAGE);
    each("model-show-vmc", &format!("model show {VMC}"), &TEXT_JSON);
    each("model-show-grinder", "model show config/examples/grinder-xyba/model.toml", &[("", "")]);
    each("model-show-lathe", "model show config/examples/lathe-2ax/model.toml", &[("", "")]);
    each("model-show-refused", "model show", &[("", "DATA/head.toml"), ("-missing", "nothing.toml")]);
}

#[test]
fn report() {
    let validation =
        "--validation DATA/verified.json --head DATA/head.toml --config config/examples/vmc-850/machine.toml";
    each(
        "model-report",
        "model report",
        &[
            ("", &format!("{VMC} {validation} --html SCRATCH/page.html")),
            ("-json", "DATA/model-full.toml --html SCRATCH/page.html --json"),
            ("-stdout", &format!("{VMC} --html - --json")),
            ("-machine", &format!("DATA/model-full.toml {validation} --html SCRATCH/page.html")),
            ("-validation", &format!("{VMC} --validation DATA/head.toml --html SCRATCH/page.html")),
        ],
    );
}

#[test]
fn assemble() {
    let two = "model assemble DATA/part-a.toml DATA/part-b.toml";
    each("model-assemble", &format!("{two} --average all --out SCRATCH/m.toml"), &TEXT_JSON);
    let motion =
        "--motion x=DATA/motions-x.csv --measured-at DATA/motions-x.csv=0,100,-50 --prefer part-a.toml";
    each("model-assemble-motion", &format!("{two} {motion} --out SCRATCH/m.toml"), &TEXT_JSON);
    each(
        "model-assemble-refused",
        "model assemble --out SCRATCH/m.toml",
        &[
            ("-nothing", ""),
            ("-disagree", "DATA/part-a.toml DATA/part-b.toml"),
            ("-base", "--motion x=DATA/motions-x.csv"),
            ("-prefer", "DATA/part-a.toml --prefer c.toml"),
            ("-absolute", "DATA/part-a.toml --absolute c.toml"),
            ("-average", "DATA/part-a.toml --average exq"),
            ("-significance", "DATA/part-a.toml --significance 1"),
            ("-std", "DATA/part-a.toml --assume-std-um 0"),
            ("-axis", "DATA/part-a.toml --motion c=DATA/motions-x.csv"),
        ],
    );
}

#[test]
fn extend() {
    let vmc = format!("model extend --model {VMC} --add DATA/addition.toml --out SCRATCH/m.toml");
    each("model-extend", &vmc, &TEXT_JSON);
    each("model-extend-forecast", &format!("{vmc} --report DATA/diagnosed.json"), &TEXT_JSON);
    each(
        "model-extend-refused",
        "model extend --add DATA/addition.toml --out SCRATCH/m.toml",
        &[
            ("-machine", "--model DATA/model-full.toml"),
            ("-report", &format!("--model {VMC} --report DATA/head.toml")),
        ],
    );
}

#[test]
fn normalise() {
    each("model-normalise", "model normalise DATA/model-full.toml --out SCRATCH/m.toml", &TEXT_JSON);
    each("model-normalise-vmc", &format!("model normalise {VMC} --out SCRATCH/m.toml"), &TEXT_JSON);
}

#[test]
fn check() {
    each("check-model", "check DATA/model-full.toml", &TEXT_JSON);
    each("check-vmc", "check config/examples/vmc-850/machine.toml", &TEXT_JSON);
    each("check-gantry", "check config/examples/gantry-5ax/machine.toml", &TEXT_JSON);
    each("check-several", &format!("check {VMC} DATA/head.toml nothing.toml"), &TEXT_JSON);
}

#[test]
fn diff() {
    each("diff", "diff DATA/part-a.toml DATA/part-b.toml", &TEXT_JSON_PAGE);
    each("diff-full", "diff DATA/model-full.toml DATA/model-other.toml", &TEXT_JSON_PAGE);
    each("diff-same", &format!("diff {VMC} {VMC}"), &TEXT_JSON_PAGE);
    each(
        "diff-tolerance",
        "diff DATA/part-a.toml DATA/part-b.toml",
        &[("", "--tolerance-um 50"), ("-refused", "--tolerance-um=-1")],
    );
    each("diff-chains", &format!("diff {VMC} DATA/model-full.toml"), &TEXT_JSON);
}
