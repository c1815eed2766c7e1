//! Rows to a Parquet file: every column optional, packed with LZ4, row groups of bounded size.

use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::Sink;
use super::rows::{Cell, Column, Kind};
use crate::prelude::*;
use volcomp_protocol::record::Meta;

/// Rows kept before they are written.
const GROUP: usize = 65_536;

/// Values of a column, without the empty ones.
enum Values {
    Number(Vec<f64>),
    Whole(Vec<i64>),
    Text(Vec<ByteArray>),
}

/// One column of the row group being filled.
struct Filling {
    values: Values,
    /// 1 where there is a value.
    present: Vec<i16>,
}

type Writer = SerializedFileWriter<BufWriter<File>>;

/// The file being written.
pub(super) struct Table {
    path: PathBuf,
    file: Option<File>,
    about: Vec<KeyValue>,
    writer: Option<Writer>,
    columns: Vec<Filling>,
    rows: usize,
}

impl Table {
    pub(super) fn new(file: File, path: &Path, meta: &Meta) -> Self {
        let pairs = [
            ("machine", &meta.machine),
            ("model_hash", &meta.model_hash),
            ("config_hash", &meta.config_hash),
            ("begun", &meta.begun),
            ("run", &meta.run),
            ("software", &meta.software),
        ];
        let about = pairs.map(|(key, value)| KeyValue::new(format!("volcomp.{key}"), value.clone())).to_vec();
        Self { path: path.to_owned(), file: Some(file), about, writer: None, columns: Vec::new(), rows: 0 }
    }

    /// Writes the last rows and what a reader finds them by.
    pub(super) fn finish(mut self) -> Result<()> {
        self.group()?;
        let closed = self.writer.take().map(Writer::close).transpose();
        closed.map(drop).map_err(|e| failure(&self.path, &e))
    }

    fn group(&mut self) -> Result<()> {
        let Some(writer) = self.writer.as_mut().filter(|_| self.rows > 0) else { return Ok(()) };
        write_group(writer, &mut self.columns).map_err(|e| failure(&self.path, &e))?;
        self.rows = 0;
        Ok(())
    }
}

impl Sink for Table {
    fn begin(&mut self, columns: &[Column]) -> Result<()> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let properties = WriterProperties::builder()
            .set_compression(Compression::LZ4_RAW)
            .set_created_by(concat!("volcomp ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_key_value_metadata(Some(std::mem::take(&mut self.about)))
            .build();
        let writer = schema(columns)
            .and_then(|s| Writer::new(BufWriter::new(file), Arc::new(s), Arc::new(properties)));
        self.writer = Some(writer.map_err(|e| failure(&self.path, &e))?);
        let filling = |column: &Column| {
            let values = match column.kind {
                Kind::Number => Values::Number(Vec::new()),
                Kind::Whole => Values::Whole(Vec::new()),
                Kind::Text => Values::Text(Vec::new()),
            };
            Filling { values, present: Vec::new() }
        };
        self.columns = columns.iter().map(filling).collect();
        Ok(())
    }

    fn row(&mut self, cells: &[Cell]) -> Result<()> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            match (&mut column.values, cell) {
                (Values::Number(values), Cell::Number(v)) => values.push(*v),
                (Values::Whole(values), Cell::Whole(v)) => values.push(*v),
                (Values::Text(values), Cell::Text(v)) => values.push(ByteArray::from(*v)),
                _ => {
                    column.present.push(0);
                    continue;
                }
            }
            column.present.push(1);
        }
        self.rows += 1;
        if self.rows >= GROUP { self.group() } else { Ok(()) }
    }
}

fn schema(columns: &[Column]) -> Result<Type, ParquetError> {
    let field = |column: &Column| {
        let (physical, converted) = match column.kind {
            Kind::Number => (Physical::DOUBLE, ConvertedType::NONE),
            Kind::Whole => (Physical::INT64, ConvertedType::NONE),
            Kind::Text => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
        };
        Type::primitive_type_builder(&column.name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_converted_type(converted)
            .build()
            .map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    Type::group_type_builder("recording").with_fields(fields).build()
}

fn write_group(writer: &mut Writer, columns: &mut [Filling]) -> Result<(), ParquetError> {
    let mut group = writer.next_row_group()?;
    for Filling { values, present } in columns {
        let Some(mut column) = group.next_column()? else { break };
        match values {
            Values::Number(values) => {
                column.typed::<DoubleType>().write_batch(values, Some(present), None)?;
                values.clear();
            }
            Values::Whole(values) => {
                column.typed::<Int64Type>().write_batch(values, Some(present), None)?;
                values.clear();
            }
            Values::Text(values) => {
                column.typed::<ByteArrayType>().write_batch(values, Some(present), None)?;
                values.clear();
            }
        }
        present.clear();
        column.close()?;
    }
    group.close().map(drop)
}

fn failure(path: &Path, error: &ParquetError) -> Failure {
    failure!(EX_IOERR, "{}: {error}", path.display())
}
