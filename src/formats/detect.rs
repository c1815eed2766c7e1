//! Which format a file has, by its beginning.

use super::{api_pos, b5r, camonitor, edge, heidenhain, isg, isg_lis, iso230_dat, rtl, rtx, text};

/// Bytes of the beginning that decide.
pub const HEAD: usize = 1 << 16;

/// A format of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Renishaw static laser test.
    Rtl,
    /// Renishaw dynamic laser test.
    Rtx,
    /// Renishaw ballbar figures.
    B5r,
    /// SINUMERIK Edge capture.
    Edge,
    /// ISO 230-2 test of an ecmc logger.
    Iso230Dat,
    /// ISG or Beckhoff volumetric table.
    Isg,
    /// ISG or Beckhoff leadscrew table.
    IsgLis,
    /// Heidenhain compensation table.
    Heidenhain,
    /// API laser means.
    ApiPos,
    /// EPICS camonitor log.
    Camonitor,
    /// LinuxCNC screw compensation.
    LinuxCnc,
    /// Any table with a column map.
    Columns,
}

/// Says whether a beginning is of a format.
type Recogniser = fn(&str) -> bool;

/// The format of a file from its first [`HEAD`] bytes (or all of them). Tables of plain numbers (LinuxCNC, any CSV) do not give
/// theirs away: they have to be named.
#[must_use]
pub fn format(head: &[u8]) -> Option<Format> {
    let head = &head[..head.len().min(HEAD)];
    if rtx::recognises(head) {
        return Some(Format::Rtx);
    }
    let decoded = text::decode(head);
    let text = decoded.text.as_ref();
    let recognisers: [(Recogniser, Format); 9] = [
        (rtl::recognises, Format::Rtl),
        (b5r::recognises, Format::B5r),
        (edge::recognises, Format::Edge),
        (iso230_dat::recognises, Format::Iso230Dat),
        (isg_lis::recognises, Format::IsgLis),
        (heidenhain::recognises, Format::Heidenhain),
        (api_pos::recognises, Format::ApiPos),
        (camonitor::recognises, Format::Camonitor),
        (isg::recognises, Format::Isg),
    ];
    recognisers.into_iter().find(|(is, _)| is(text)).map(|(_, format)| format)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beginnings_give_formats_away() {
        for (head, expected) in [
            ("HEADER::\r\nFile type  : rtl\r\n\r\nTARGET DATA::\r\n", Some(Format::Rtl)),
            ("HEADER::\r\nSample no: 3\r\nData:\r\n", Some(Format::Rtx)),
            ("<?xml version=\"1.0\"?>\n<A><FEATURE NAME=\"a\"/></A>", Some(Format::B5r)),
            ("{\"Header\": {\"SignalListHFData\": []}}", Some(Format::Edge)),
            ("TGT_DATA[1]=0\nREF_DATA_FWD[1,1]=0\n", Some(Format::Iso230Dat)),
            ("kopf.log_achs_nr 1\nkw.ssfk.unit 1\n", Some(Format::IsgLis)),
            ("NR AXISPOS X\n0 0 0\n", Some(Format::Heidenhain)),
            ("Position   \tBidirectional Avg Error\n0 0\n", Some(Format::ApiPos)),
            ("A:B 2022-11-08 15:23:24.5 1\n", Some(Format::Camonitor)),
            ("X EXX\n0 0\n", Some(Format::Isg)),
            ("0 0 0\n1 1 1\n", None),
            ("cycle,direction,target_mm,deviation_um\n1,1,0,0\n", None),
            ("position_mm,exx_um\n0,1\n", None),
            ("", None),
        ] {
            assert_eq!(format(head.as_bytes()), expected, "{head:?}");
        }
    }
}
