//! `volcomp import` and `volcomp export`.

use super::each;

#[test]
fn import_tests() {
    each(
        "import-test",
        "import --out SCRATCH/x.csv",
        &[
            ("-rtl", "tests/formats/laser-x.rtl"),
            ("-dat", "tests/formats/sessions/stage.dat"),
            ("-pos", "DATA/means.pos"),
            ("-two", "tests/formats/laser-x.rtl tests/formats/laser-x.rtl"),
            (
                "-columns",
                "DATA/soll.csv --columns target=Soll:mm,deviation=Abw:um --delimiter ; --decimal-comma --skip-lines 1",
            ),
            ("-map", "DATA/soll.csv --map DATA/map.toml"),
            ("-axis", "tests/formats/laser-x.rtl --axis c"),
            ("-unit", "tests/formats/laser-x.rtl --axis x --deviation-unit mrad"),
            ("-into", "tests/formats/laser-x.rtl --into DATA/part-a.toml"),
            ("-kinds", "tests/formats/laser-x.rtl DATA/means.pos"),
            ("-unknown", "DATA/head.toml"),
            ("-stdin", "-"),
            ("-bad-column", "DATA/soll.csv --columns target"),
            (
                "-bad-units",
                "DATA/soll.csv --columns target=Soll:mm,deviation=Abw:arcsec --delimiter ; --skip-lines 1 --decimal-comma",
            ),
        ],
    );
}

#[test]
fn import_series() {
    each(
        "import-series",
        "import --out SCRATCH/x.csv",
        &[
            ("-edge", "tests/formats/sinumerik-840dsl/capture.json --axes x=1,c=4"),
            ("-edge-all", "tests/formats/sinumerik-840dsl/capture.json"),
            ("-edge-axes", "tests/formats/sinumerik-840dsl/capture.json --axes x=9"),
            ("-camonitor", "DATA/monitor.log"),
            ("-b5r", "tests/formats/sessions/figures.b5r"),
            (
                "-columns",
                "DATA/soll.csv --columns x_mm=Soll:mm,y_um=Abw:um --delimiter ; --decimal-comma --skip-lines 1",
            ),
            ("-several", "DATA/monitor.log DATA/monitor.log"),
        ],
    );
    each(
        "import-series-b5r-json",
        "import tests/formats/sessions/figures.b5r",
        &[("", "--out SCRATCH/x.json"), ("-out", "")],
    );
}

#[test]
fn import_tables() {
    each(
        "import-table",
        "import --out SCRATCH/m.toml",
        &[
            ("-linuxcnc", "DATA/x.comp --format linuxcnc --axis x --comp-type 0 --machine m1"),
            ("-linuxcnc-inch", "DATA/x.comp --format linuxcnc --axis x --comp-type 1 --linear-units inch"),
            ("-heidenhain", "DATA/y.com --axis y --sign deviation"),
            ("-isg-lis", "DATA/x.lis --axis x --increment-um 1"),
            ("-isg", "DATA/vc.csv --sense carriage"),
            ("-no-sense", "DATA/vc.csv"),
            ("-no-axis", "DATA/y.com"),
            ("-no-type", "DATA/x.comp --format linuxcnc --axis x"),
            ("-twice", "DATA/y.com DATA/y.com --axis y --sign correction"),
            ("-carriage", "DATA/x.comp --format linuxcnc --axis x --comp-type 0 --into DATA/model-full.toml"),
            ("-reference", "DATA/vc.csv --sense relative --into DATA/model-other.toml"),
        ],
    );
}

#[test]
fn export_models() {
    each(
        "export-model",
        "export DATA/part-b.toml --out SCRATCH/x.csv",
        &[
            ("-isg", "--format isg --sense relative --tolerance-um 5"),
            ("-linuxcnc", "--format linuxcnc --axis y --comp-type 1 --step 50"),
            ("-isg-lis", "--format isg-lis --axis y --step 50"),
            ("-heidenhain", "--format heidenhain --axis y --sign correction --step 50"),
            ("-rtl", "--format rtl --axis y --step 100"),
            ("-rtl-two-ways", "--format rtl --axis x"),
            ("-csv", "--format csv --axis x --step 100"),
            ("-csv-y", "--format csv --axis y --step 100 --range 0:200"),
            ("-no-axis", "--format csv"),
            ("-no-error", "--format csv --axis c"),
            ("-rotary", "--format rtl --axis c"),
            ("-tolerance", "--format csv --axis x --tolerance-um 0"),
            ("-parquet", "--format parquet"),
            ("-recording-option", "--format csv --axis x --every 2"),
            ("-several", "DATA/part-a.toml --format csv --axis x"),
            ("-isg-two-steps", "--format isg --step 50"),
        ],
    );
}

#[test]
fn export_full_model() {
    each(
        "export-full",
        "export DATA/model-full.toml --out SCRATCH/x.csv",
        &[
            ("-grid", "--format csv --axis y"),
            ("-directions", "--format isg --sense carriage"),
            ("-rtl", "--format rtl --axis x"),
            ("-csv", "--format csv --axis x --step 100 --direction mean"),
        ],
    );
}

#[test]
fn export_recordings() {
    each(
        "export-recording",
        "export tests/recordings/three-axes.vcrec --out SCRATCH/x.csv",
        &[
            ("", "--format csv --every 200"),
            ("-part", "--format csv --from-s 0.5 --to-s 0.51"),
            ("-nothing", "--format csv --from-s 500"),
            ("-order", "--format csv --from-s 5 --to-s 4"),
            ("-format", "--format isg"),
            ("-option", "--format csv --axis x"),
        ],
    );
    let more = "--format csv --every 400 --out SCRATCH/x.csv";
    each(
        "export-recording-five-axes",
        &format!("export tests/recordings/five-axes.vcrec {more}"),
        &[("", "")],
    );
    each("export-recording-live", &format!("export tests/recordings/live-filter.vcrec {more}"), &[("", "")]);
    each("export-recording-faults", &format!("export tests/recordings/faults.vcrec {more}"), &[("", "")]);
}
