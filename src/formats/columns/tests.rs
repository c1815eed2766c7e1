use super::*;
use proptest::prelude::*;

fn map(columns: &[(&str, &str)]) -> ColumnMap {
    let mut map = ColumnMap { header: true, ..ColumnMap::default() };
    for (output, source) in columns {
        map.add(output, source).unwrap();
    }
    map
}

fn rows(text: &str, map: ColumnMap) -> Result<Vec<Vec<f64>>, ReadError> {
    let mut table = Columns::new(text.as_bytes(), map)?;
    let mut all = Vec::new();
    while table.advance()? {
        all.push(table.values().to_vec());
    }
    Ok(all)
}

#[test]
fn names_numbers_units_and_quotes() {
    let text =
        "Maschine;VMC\r\n\r\n\"Soll [mm]\";Ist;\"a;b\"\r\n0,0;0,0015;-1,5\r\n# Pause\r\n10;10,002;2\r\n";
    let mut of = map(&[("target", "Soll [mm]:mm"), ("deviation", "#3:um")]);
    (of.skip_lines, of.decimal_comma) = (2, true);
    assert_eq!(rows(text, of.clone()).unwrap(), [[0.0, -1.5e-3], [10.0, 2e-3]]);
    assert!(of.check().is_ok() && of.is_test());
    let series = map(&[("t_s", "t:ms"), ("x_um", "x:inch"), ("temp_degc", "T")]);
    assert_eq!(rows("x\tt\tT\n1\t250\t20.5\n", series).unwrap(), [[0.25, 25_400.0, 20.5]]);
    let mut bare = map(&[("t_s", "#1:s"), ("x_mm", "#2:mm")]);
    bare.header = false;
    assert_eq!(rows("  0   1\n 0.5\t 2 \n", bare).unwrap(), [[0.0, 1.0], [0.5, 2.0]]);
}

#[test]
fn a_row_with_more_fields_than_the_header_is_refused() {
    let of = map(&[("target", "t:mm"), ("deviation", "d:um")]);
    let said = |text: &str| rows(text, of.clone()).unwrap_err().to_string();
    assert_eq!(
        said("t,d\n0,1\n10,2,5\n"),
        "3:1: 3 fields, the header has 2 columns; is there a decimal comma?"
    );
    assert!(said("t;d\n0;1;9\n").starts_with("2:1: 3 fields"));
    assert!(rows("t;d\n0;1;\n10;2;\n", of).is_ok());
    let mut bare = map(&[("t_s", "#1:s"), ("x_mm", "#2:mm")]);
    bare.header = false;
    assert!(rows("0 1\n1 2 3\n", bare).unwrap_err().to_string().starts_with("2:1: 3 fields"));
}

#[test]
fn time_stamps_become_seconds() {
    let of = map(&[("t_s", "Time:dmy"), ("x_mm", "X [mm]:mm")]);
    let text = "X [mm];Time\n1.5;'08.11.2022 23:59:59.953\n2;'09.11.2022 00:00:01.000\n";
    assert_eq!(rows(text, of).unwrap(), [[0.0, 1.5], [1.047, 2.0]]);
    let mut of = map(&[("t_s", "#1:filetime"), ("x_mm", "#2:mm")]);
    (of.header, of.skip_lines) = (false, 1);
    assert_eq!(rows("Name;x\n132537600000000000;1\n132537600000020000;2\n", of).unwrap()[1], [0.002, 2.0]);
}

#[test]
fn maps_are_read_from_toml() {
    let text = "delimiter = \";\"\ndecimal-comma = true\nskip-lines = 2\nencoding = \"cp1252\"\n[columns]\ntarget = \"Soll:mm\"\nactual = \"#2:mm\"\n";
    let map = ColumnMap::from_toml(text).unwrap();
    assert_eq!((map.delimiter, map.skip_lines, map.header), (Some(Delimiter::Character(';')), 2, true));
    assert_eq!(map.columns.len(), 2);
    let fails = |from: &str, to: &str| ColumnMap::from_toml(&text.replace(from, to)).unwrap_err().to_string();
    assert!(fails("decimal-comma", "decimal").starts_with("2:1: unknown field `decimal`"));
    assert!(fails("\"Soll:mm\"", "3").contains("expected a text such as"));
    assert!(fails("Soll:mm", "Soll:furlong").contains("found 'furlong', expected a unit"));
    assert!(fails("\";\"", "\"::\"").contains("expected a delimiter"));
    assert!(fails("cp1252", "ebcdic").contains("expected an encoding"));
}

#[test]
fn maps_are_checked() {
    let mut of = ColumnMap::default();
    let mut fails = |output: &str, source: &str| of.add(output, source).unwrap_err().to_string();
    assert!(fails("x", "x").contains("an output that ends in its unit"));
    assert!(fails("x_mm", "x:deg").contains("can be converted from"));
    assert!(fails("x_mm", "#0:mm").contains("a column number such as #1"));
    assert!(fails("target", "x").contains("a unit of length or angle"));
    assert!(fails("t_ms", "x:dmy").contains("can be converted from"));
    assert!(ColumnMap::default().check().is_err());
    assert!(map(&[("target", "a:mm")]).check().unwrap_err().to_string().contains("deviation or actual"));
    assert!(
        map(&[("target", "a:mm"), ("x_mm", "b:mm")]).check().unwrap_err().to_string().contains("stand alone")
    );
    assert!(map(&[("deviation", "a:um")]).check().unwrap_err().to_string().contains("the output target"));
}

#[test]
fn mistakes_name_their_place() {
    let of = || map(&[("t_s", "t:s"), ("x_mm", "x:mm")]);
    for (text, expected) in [
        ("", "1:1: the table is missing"),
        ("t;y\n", "1:1: column x is not read: the header has no such column"),
        ("t;x;x\n", "1:5: column x was given before"),
        ("t;x\n1;2\n3; 4x\n", "3:4: '4x' is not a finite number"),
        ("t;x\n1\n", "2:1: fields: 2 announced, 1 found"),
        ("t;x\n1;nan\n", "2:3: 'nan' is not a finite number"),
    ] {
        let message = rows(text, of()).unwrap_err().to_string();
        assert!(message.contains(expected), "{text:?} gives {message:?}");
    }
    let mut comma = of();
    comma.decimal_comma = true;
    assert!(rows("t;x\n1;1.234,5\n", comma).unwrap_err().to_string().contains("no other point"));
    let mut skip = of();
    skip.skip_lines = 3;
    assert!(
        rows("t;x\n", skip).unwrap_err().to_string().contains("lines above the table: 3 announced, 1 found")
    );
}

proptest! {
    #[test]
    fn damaged_tables_never_panic(text in "[a-z0-9;,\"# .\t\n\u{e4}-]{0,80}", comma: bool, header: bool) {
        let mut of = map(&[("t_s", "#1:s"), ("x_mm", "#2:mm")]);
        (of.decimal_comma, of.header) = (comma, header);
        let _ = rows(&text, of);
    }

    #[test]
    fn damaged_maps_never_panic(text in "[a-z\\-=\"\\[\\]#:0-9\n ]{0,80}") {
        let _ = ColumnMap::from_toml(&format!("skip-lines = 1\n{text}\n[columns]\n{text}"));
    }
}
