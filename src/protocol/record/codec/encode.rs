//! Entries to bytes.

use super::{Past, Port, Status, bit, length_of, tag, usable};
use crate::record::block::{self, BlockKind};
use crate::record::bytes::{put_varint, zigzag};
use crate::record::{Answer, Context, Cycle, Entry, LIVE_MAX, RecordError};
use crate::{ControlHello, MAX_FRAME, Message, Position, Tool, encode};
use volcomp_units::MonoTime;
use volcomp_units::axes::{AxisArray, MAX_AXES};

/// Packs entries into the content of a block.
#[derive(Debug, Default)]
pub struct Encoder {
    out: Vec<u8>,
    packer: Packer,
    past: Past,
    context: Context,
    /// Number of the next entry.
    next: u64,
    first: u64,
    first_ns: i64,
    records: u32,
}

impl Encoder {
    /// An encoder whose first entry has number 0.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of the next entry.
    #[must_use]
    pub const fn next_record(&self) -> u64 {
        self.next
    }

    /// Bytes packed so far.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.out.len()
    }

    /// True where no entry waits to be sealed.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.records == 0
    }

    /// Adds an entry.
    pub fn push(&mut self, entry: &Entry) {
        if self.records == 0 {
            self.out.clear();
            self.past = Past::default();
            self.first = self.next;
            self.first_ns = entry.now().ns;
            put_context(&mut self.out, &self.context);
        }
        self.put(entry);
        self.context.follow(entry);
        self.next += 1;
        self.records += 1;
    }

    /// Passes over an entry that cannot be kept, between two blocks: it counts, and the next block tells how things stand
    /// after it.
    pub fn skip(&mut self, entry: &Entry) {
        self.context.follow(entry);
        self.next += 1;
    }

    /// The block of the entries added since the last one; `None` where there are none.
    pub fn seal(&mut self) -> Option<Vec<u8>> {
        let records = core::mem::take(&mut self.records);
        if records == 0 {
            return None;
        }
        block::seal(BlockKind::Entries, self.first, records, self.first_ns, &self.out)
    }

    /// Number, time and count of the entries that [`Encoder::seal`] would put into a block.
    #[must_use]
    pub const fn pending(&self) -> (u64, i64, u32) {
        (self.first, self.first_ns, self.records)
    }

    fn put(&mut self, entry: &Entry) {
        match entry {
            Entry::Cycle(cycle) => self.cycle(cycle),
            Entry::Deadline { now, enabled, answer } => self.deadline(*now, *enabled, answer.as_ref()),
            Entry::Tool { now, tool } => self.other(tag::TOOL, *now, |out| put_tool(out, tool)),
            Entry::Request { now, request } => self.other(tag::REQUEST, *now, |out| {
                out.push(request.code);
                out.extend_from_slice(&request.value.to_le_bytes());
            }),
            Entry::LinkUp { now } => self.other(tag::LINK_UP, *now, |_| ()),
            Entry::LinkDown { now } => self.other(tag::LINK_DOWN, *now, |_| ()),
            Entry::Engine { now, hello } => self.other(tag::ENGINE, *now, |out| put_hello(out, hello)),
            Entry::Model { now, hash } => self.other(tag::MODEL, *now, |out| out.extend_from_slice(hash)),
            Entry::Gap { now, dropped, context } => self.other(tag::GAP, *now, |out| {
                put_varint(out, *dropped);
                put_context(out, context);
            }),
            Entry::Live { now, told, values } => self.live(*now, *told, *values),
        }
    }

    /// An entry with its length in front.
    fn other(&mut self, tag: u8, now: MonoTime, content: impl FnOnce(&mut Vec<u8>)) {
        self.out.push(tag);
        let data = &mut self.packer.data;
        data.clear();
        put_varint(data, zigzag(now.ns.wrapping_sub(self.past.now)));
        self.past.now = now.ns;
        content(data);
        put_varint(&mut self.out, data.len() as u64);
        self.out.extend_from_slice(data);
    }

    fn time(&mut self, now: MonoTime) {
        let interval = now.ns.wrapping_sub(self.past.now);
        put_varint(&mut self.out, zigzag(interval.wrapping_sub(self.past.interval)));
        (self.past.now, self.past.interval) = (now.ns, interval);
    }

    fn cycle(&mut self, cycle: &Cycle) {
        let Cycle { now, mut frame, enabled, answer } = *cycle;
        let past = &self.past;
        let status = status_of(answer.as_ref(), enabled, past.status);
        let step =
            zigzag(i64::from(frame.sequence.wrapping_sub(past.sequence).cast_signed()).wrapping_sub(1));
        let arrays = [&frame.commanded, &frame.applied, &frame.actual];
        let wide = is_wide(arrays.into_iter().chain(answered(answer.as_ref())), self.context.axes());
        let other = answer.is_some_and(|a| a.sequence != frame.sequence);
        let flags = flag_bits([
            (answer.is_some(), bit::ANSWERED),
            (frame.state.bits != past.machine, bit::MACHINE),
            (frame.feed_mm_per_min.to_bits() != past.feed.0[0], bit::FEED),
            (status != past.status, bit::STATUS),
            (wide, bit::WIDE),
            (step != 0, bit::STEP),
            (other, bit::OTHER),
            (answer.is_some_and(|a| a.change.is_some()), bit::CHANGE),
        ]);
        self.out.extend_from_slice(&[tag::CYCLE, flags]);
        self.time(now);
        let interval = frame.control_ns.wrapping_sub(self.past.control_ns);
        put_varint(&mut self.out, zigzag(interval.wrapping_sub(self.past.control_interval)));
        (self.past.control_ns, self.past.control_interval) = (frame.control_ns, interval);
        if step != 0 {
            put_varint(&mut self.out, step);
        }
        self.past.sequence = frame.sequence;
        if flags & bit::MACHINE != 0 {
            self.out.extend_from_slice(&frame.state.bits.to_le_bytes());
            self.past.machine = frame.state.bits;
        }
        if flags & bit::FEED != 0 {
            self.out.extend_from_slice(&frame.feed_mm_per_min.to_le_bytes());
            self.past.feed.push(frame.feed_mm_per_min);
        }
        self.answer(flags, status, answer.as_ref());
        let count = if wide { MAX_AXES } else { self.context.axes() };
        self.numbers(count, Some(&mut frame), answer);
    }

    fn deadline(&mut self, now: MonoTime, enabled: bool, answer: Option<&Answer>) {
        let status = status_of(answer, enabled, self.past.status);
        let wide = is_wide(answered(answer), self.context.axes());
        let other = answer.is_some_and(|a| a.sequence != self.past.sequence);
        let flags = flag_bits([
            (answer.is_some(), bit::ANSWERED),
            (status != self.past.status, bit::STATUS),
            (wide, bit::WIDE),
            (other, bit::OTHER),
            (answer.is_some_and(|a| a.change.is_some()), bit::CHANGE),
        ]);
        self.out.extend_from_slice(&[tag::DEADLINE, flags]);
        self.time(now);
        self.answer(flags, status, answer);
        let count = if wide { MAX_AXES } else { self.context.axes() };
        self.numbers(count, None, answer.copied());
    }

    /// What of an answer is not a number along a path.
    fn answer(&mut self, flags: u8, status: Status, answer: Option<&Answer>) {
        if flags & bit::STATUS != 0 {
            self.out.extend_from_slice(&status);
            self.past.status = status;
        }
        if let Some(answer) = answer.filter(|_| flags & bit::OTHER != 0) {
            self.out.extend_from_slice(&answer.sequence.to_le_bytes());
        }
        if let Some(change) = answer.and_then(|a| a.change) {
            self.out.push(change.from.code());
            self.out.extend_from_slice(&change.cause.to_le_bytes());
        }
    }

    fn live(&mut self, now: MonoTime, told: u32, mut values: [f64; LIVE_MAX]) {
        match u16::try_from(told) {
            Ok(few) => {
                self.out.push(tag::LIVE);
                self.out.extend_from_slice(&few.to_le_bytes());
            }
            Err(_) => {
                self.out.push(tag::LIVE_MANY);
                self.out.extend_from_slice(&told.to_le_bytes());
            }
        }
        self.time(now);
        self.packer.control.clear();
        self.packer.data.clear();
        // a packer takes everything
        let _ = self.past.live(&mut self.packer, told, &mut values);
        self.out.extend_from_slice(&self.packer.control);
        self.out.extend_from_slice(&self.packer.data);
    }

    fn numbers(&mut self, count: usize, frame: Option<&mut Position>, answer: Option<Answer>) {
        self.packer.control.clear();
        self.packer.data.clear();
        // a packer takes everything
        if let Some(frame) = frame {
            let _ = self.past.arrays(&mut self.packer, frame, count);
        }
        if let Some(mut answer) = answer {
            let _ = self.past.offsets(&mut self.packer, &mut answer, count);
        }
        self.out.extend_from_slice(&self.packer.control);
        self.out.extend_from_slice(&self.packer.data);
    }
}

/// The bits of what is so.
fn flag_bits<const N: usize>(parts: [(bool, u8); N]) -> u8 {
    parts.into_iter().fold(0, |all, (set, bit)| if set { all | bit } else { all })
}

/// The numbers of an answer.
fn answered(answer: Option<&Answer>) -> impl Iterator<Item = &AxisArray> {
    answer.into_iter().flat_map(|a| [&a.offset, &a.wanted])
}

/// True where a slot without an axis is not zero.
fn is_wide<'v>(mut arrays: impl Iterator<Item = &'v AxisArray>, axes: usize) -> bool {
    arrays.any(|a| a[axes.min(MAX_AXES)..].iter().any(|v| v.to_bits() != 0))
}

/// Control bytes and data of one entry's numbers.
#[derive(Debug, Default)]
struct Packer {
    control: Vec<u8>,
    data: Vec<u8>,
}

impl Port for Packer {
    fn number(&mut self, value: f64, predictions: &[f64; 4], fallback: f64) -> Result<f64, RecordError> {
        let bits = value.to_bits();
        let difference = |p: f64| zigzag(bits.wrapping_sub(usable(p, fallback)).cast_signed());
        let mut best = (0_u8, difference(predictions[0]));
        for (k, prediction) in (0_u8..).zip(predictions).skip(1) {
            let candidate = difference(*prediction);
            if length_of(candidate) < length_of(best.1) {
                best = (k, candidate);
            }
        }
        let length = length_of(best.1);
        self.control.push(best.0 << 4 | length as u8);
        self.data.extend_from_slice(&best.1.to_le_bytes()[..length]);
        Ok(value)
    }
}

fn status_of(answer: Option<&Answer>, enabled: bool, before: Status) -> Status {
    let Some(a) = answer else {
        let [.., flags] = before;
        let mut status = before;
        status[6] = flags & 1 | u8::from(enabled) << 1;
        return status;
    };
    let flags = u8::from(a.stopped) | u8::from(enabled) << 1;
    [a.state.code(), a.limited, a.warning, a.out_of_range, a.faded, a.lag_cycles, flags]
}

/// A message in the frame that it has on the link, behind its length.
fn put_message(out: &mut Vec<u8>, message: &Message) {
    let mut frame = [0; MAX_FRAME];
    let length = encode(message, &mut frame);
    put_varint(out, length as u64);
    out.extend_from_slice(&frame[..length]);
}

fn put_hello(out: &mut Vec<u8>, hello: &ControlHello) {
    put_message(out, &Message::ControlHello(*hello));
}

fn put_tool(out: &mut Vec<u8>, tool: &Tool) {
    put_message(out, &Message::Tool(*tool));
}

fn put_context(out: &mut Vec<u8>, context: &Context) {
    let Context { hello, link, enabled, gain, tool, model } = context;
    let parts = [hello.is_some(), *link, *enabled, gain.is_some(), tool.is_some(), model.is_some()];
    out.push((0..).zip(parts).fold(0, |all, (k, set)| all | u8::from(set) << k));
    if let Some(hello) = hello {
        put_hello(out, hello);
    }
    if let Some(gain) = gain {
        out.extend_from_slice(&gain.to_le_bytes());
    }
    if let Some(tool) = tool {
        put_tool(out, tool);
    }
    if let Some(model) = model {
        out.extend_from_slice(model);
    }
}
