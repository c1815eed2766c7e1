//! Entries to few bytes and back, bit for bit.
//!
//! Numbers that follow a path are predicted from those before them, and only the difference of their bit patterns is
//! kept, in as many bytes as it needs. Which of four predictions was nearest stands beside it. Predictions use
//! additions only, which every IEEE 754 machine rounds alike; one that is not finite falls back to the value before.

use super::bytes::{Cursor, put_varint, unzigzag, zigzag};
use super::entry::{Answer, Context, Cycle, Entry, Request};
use super::error::RecordError;
use crate::core::axes::{AxisArray, MAX_AXES};
use crate::core::protocol::{
    ControlHello, CorrectionState, MAX_FRAME, MachineState, Message, Position, Tool, decode, encode,
};
use crate::core::units::MonoTime;

/// Tags of entries. From 128 on an entry is an input of the engine; all but the first two carry their length.
mod tag {
    pub(super) const GAP: u8 = 1;
    pub(super) const VALUE: u8 = 2;
    pub(super) const CYCLE: u8 = 128;
    pub(super) const DEADLINE: u8 = 129;
    pub(super) const TOOL: u8 = 130;
    pub(super) const REQUEST: u8 = 131;
    pub(super) const LINK_UP: u8 = 132;
    pub(super) const LINK_DOWN: u8 = 133;
    pub(super) const ENGINE: u8 = 134;
    pub(super) const MODEL: u8 = 135;
}

/// Bits of a cycle's and a deadline's first byte.
mod bit {
    pub(super) const ANSWERED: u8 = 1;
    pub(super) const MACHINE: u8 = 1 << 1;
    pub(super) const FEED: u8 = 1 << 2;
    pub(super) const STATUS: u8 = 1 << 3;
    /// All slots of the arrays are there, not only those of the axes.
    pub(super) const WIDE: u8 = 1 << 4;
    pub(super) const STEP: u8 = 1 << 5;
    /// The answer names another frame.
    pub(super) const OTHER: u8 = 1 << 6;
}

/// The last values of one quantity of one axis, newest first, as bits.
#[derive(Debug, Clone, Copy, Default)]
struct Track([u64; 4]);

impl Track {
    fn push(&mut self, value: f64) {
        let [a, b, c, _] = self.0;
        self.0 = [value.to_bits(), a, b, c];
    }

    fn last(self) -> f64 {
        f64::from_bits(self.0[0])
    }

    /// Straight on, in a parabola, in a cubic.
    fn onward(self) -> [f64; 3] {
        let [a, b, c, d] = self.0.map(f64::from_bits);
        let (d1, d2, d3) = (a - b, b - c, c - d);
        let (s1, s2) = (d1 - d2, d2 - d3);
        [a + d1, a + (d1 + s1), a + (d1 + (s1 + (s1 - s2)))]
    }
}

/// Where a number goes, or comes from.
trait Port {
    /// Passes one number, next to its predictions; gives it back.
    fn number(&mut self, value: f64, predictions: &[f64; 4], fallback: f64) -> Result<f64, RecordError>;
}

/// What is known of the entries before.
#[derive(Debug, Clone, Default)]
struct Past {
    now: i64,
    interval: i64,
    sequence: u32,
    control_ns: i64,
    control_interval: i64,
    machine: u16,
    feed: Track,
    status: [u8; 5],
    commanded: [Track; MAX_AXES],
    /// Actual minus commanded and applied.
    following: [Track; MAX_AXES],
    applied: [Track; MAX_AXES],
    offset: [Track; MAX_AXES],
}

impl Past {
    fn arrays<P: Port>(
        &mut self,
        port: &mut P,
        frame: &mut Position,
        count: usize,
    ) -> Result<(), RecordError> {
        for k in 0..count {
            let track = &mut self.commanded[k];
            let [line, parabola, cubic] = track.onward();
            let last = track.last();
            frame.commanded[k] = port.number(frame.commanded[k], &[last, line, parabola, cubic], last)?;
            track.push(frame.commanded[k]);
        }
        for k in 0..count {
            let sent = self.offset[k];
            let track = &mut self.applied[k];
            let last = track.last();
            let before = f64::from_bits(sent.0[1]);
            frame.applied[k] =
                port.number(frame.applied[k], &[sent.last(), last, before, track.onward()[0]], last)?;
            track.push(frame.applied[k]);
        }
        for k in 0..count {
            let track = &mut self.following[k];
            let ideal = frame.commanded[k] + frame.applied[k];
            let near = [ideal, ideal + track.last(), ideal + track.onward()[0], frame.commanded[k]];
            frame.actual[k] = port.number(frame.actual[k], &near, 0.0)?;
            track.push(frame.actual[k] - ideal);
        }
        Ok(())
    }

    fn offsets<P: Port>(
        &mut self,
        port: &mut P,
        offset: &mut AxisArray,
        count: usize,
    ) -> Result<(), RecordError> {
        for (track, offset) in self.offset.iter_mut().zip(offset.iter_mut()).take(count) {
            let [line, parabola, cubic] = track.onward();
            let last = track.last();
            *offset = port.number(*offset, &[last, line, parabola, cubic], last)?;
            track.push(*offset);
        }
        Ok(())
    }
}

/// Bytes of a difference, without its leading zeros.
const fn length_of(difference: u64) -> usize {
    8 - (difference.leading_zeros() / 8) as usize
}

fn usable(prediction: f64, fallback: f64) -> u64 {
    if prediction.is_finite() { prediction.to_bits() } else { fallback.to_bits() }
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

/// The same, being read.
struct Unpacker<'c, 'a> {
    control: &'a [u8],
    data: &'c mut Cursor<'a>,
}

impl Port for Unpacker<'_, '_> {
    fn number(&mut self, _: f64, predictions: &[f64; 4], fallback: f64) -> Result<f64, RecordError> {
        let (&control, rest) = self.control.split_first().ok_or(RecordError::Short)?;
        self.control = rest;
        let length = usize::from(control & 0xf);
        let prediction = predictions.get(usize::from(control >> 4)).filter(|_| length <= 8);
        let prediction = prediction.ok_or(RecordError::Value { found: control.into() })?;
        let mut bytes = [0; 8];
        bytes[..length].copy_from_slice(self.data.take(length)?);
        let difference = unzigzag(u64::from_le_bytes(bytes)).cast_unsigned();
        Ok(f64::from_bits(usable(*prediction, fallback).wrapping_add(difference)))
    }
}

fn status_of(answer: Option<&Answer>, enabled: bool, before: [u8; 5]) -> [u8; 5] {
    let Some(a) = answer else {
        let [state, limited, warning, out_of_range, flags] = before;
        return [state, limited, warning, out_of_range, flags & 1 | u8::from(enabled) << 1];
    };
    let flags = u8::from(a.stopped) | u8::from(enabled) << 1;
    [a.state.code(), a.limited, a.warning, a.out_of_range, flags]
}

fn answer_of(status: [u8; 5], sequence: u32) -> Result<Answer, RecordError> {
    let [state, limited, warning, out_of_range, flags] = status;
    let state = CorrectionState::from_code(state).ok_or(RecordError::Value { found: state.into() })?;
    Ok(Answer {
        sequence,
        state,
        limited,
        warning,
        out_of_range,
        stopped: flags & 1 == 1,
        offset: [0.0; MAX_AXES],
    })
}

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

    /// Passes over an entry that cannot be kept: it counts, and the next block tells how things stand after it.
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
        super::block::seal(super::BlockKind::Entries, self.first, records, self.first_ns, &self.out)
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
            Entry::Value { now, channel, value } => self.other(tag::VALUE, *now, |out| {
                out.extend_from_slice(&channel.to_le_bytes());
                out.extend_from_slice(&value.to_le_bytes());
            }),
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
        let none = [0.0; MAX_AXES];
        let offset = answer.as_ref().map_or(&none, |a| &a.offset);
        let wide = is_wide(arrays.into_iter().chain([offset]), self.context.axes());
        let other = answer.is_some_and(|a| a.sequence != frame.sequence);
        let flags = [
            (answer.is_some(), bit::ANSWERED),
            (frame.state.bits != past.machine, bit::MACHINE),
            (frame.feed_mm_per_min.to_bits() != past.feed.0[0], bit::FEED),
            (status != past.status, bit::STATUS),
            (wide, bit::WIDE),
            (step != 0, bit::STEP),
            (other, bit::OTHER),
        ];
        let flags = flags.into_iter().fold(0, |all, (set, bit)| if set { all | bit } else { all });
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
        self.status(flags, status);
        if let Some(answer) = answer.filter(|_| other) {
            self.out.extend_from_slice(&answer.sequence.to_le_bytes());
        }
        let count = if wide { MAX_AXES } else { self.context.axes() };
        self.numbers(count, Some(&mut frame), answer.map(|a| a.offset));
    }

    fn deadline(&mut self, now: MonoTime, enabled: bool, answer: Option<&Answer>) {
        let status = status_of(answer, enabled, self.past.status);
        let none = [0.0; MAX_AXES];
        let wide = is_wide([answer.map_or(&none, |a| &a.offset)].into_iter(), self.context.axes());
        let other = answer.is_some_and(|a| a.sequence != self.past.sequence);
        let flags = u8::from(answer.is_some()) * bit::ANSWERED
            | u8::from(status != self.past.status) * bit::STATUS
            | u8::from(wide) * bit::WIDE
            | u8::from(other) * bit::OTHER;
        self.out.extend_from_slice(&[tag::DEADLINE, flags]);
        self.time(now);
        self.status(flags, status);
        if let Some(answer) = answer.filter(|_| other) {
            self.out.extend_from_slice(&answer.sequence.to_le_bytes());
        }
        let count = if wide { MAX_AXES } else { self.context.axes() };
        self.numbers(count, None, answer.map(|a| a.offset));
    }

    fn status(&mut self, flags: u8, status: [u8; 5]) {
        if flags & bit::STATUS != 0 {
            self.out.extend_from_slice(&status);
            self.past.status = status;
        }
    }

    fn numbers(&mut self, count: usize, frame: Option<&mut Position>, offset: Option<AxisArray>) {
        self.packer.control.clear();
        self.packer.data.clear();
        // a packer takes everything
        if let Some(frame) = frame {
            let _ = self.past.arrays(&mut self.packer, frame, count);
        }
        if let Some(mut offset) = offset {
            let _ = self.past.offsets(&mut self.packer, &mut offset, count);
        }
        self.out.extend_from_slice(&self.packer.control);
        self.out.extend_from_slice(&self.packer.data);
    }
}

/// True where a slot without an axis is not zero.
fn is_wide<'v>(mut arrays: impl Iterator<Item = &'v AxisArray>, axes: usize) -> bool {
    arrays.any(|a| a[axes.min(MAX_AXES)..].iter().any(|v| v.to_bits() != 0))
}

/// An entry, or what is known of one that this version does not know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decoded {
    /// An entry.
    Entry(Entry),
    /// An entry of a later version.
    Unknown {
        /// Its tag; from 128 on it was an input of the engine.
        tag: u8,
    },
}

/// Reads the content of a block of entries.
#[derive(Debug, Clone)]
pub struct Decoder {
    content: Vec<u8>,
    at: usize,
    past: Past,
    context: Context,
}

impl Decoder {
    /// Begins to read.
    ///
    /// # Errors
    /// The context in front is not understood.
    pub fn new(content: Vec<u8>) -> Result<Self, RecordError> {
        let mut cursor = Cursor::new(&content);
        let context = context(&mut cursor)?;
        let at = content.len() - cursor.len();
        Ok(Self { content, at, past: Past::default(), context })
    }

    /// How things stand before the next entry.
    #[must_use]
    pub const fn context(&self) -> &Context {
        &self.context
    }

    /// The next entry; `None` at the end.
    ///
    /// # Errors
    /// The bytes are not understood; nothing after them can be.
    pub fn next_entry(&mut self) -> Result<Option<Decoded>, RecordError> {
        let content = core::mem::take(&mut self.content);
        let mut cursor = Cursor::new(content.get(self.at..).unwrap_or(&[]));
        let decoded = if cursor.is_empty() { Ok(None) } else { self.decode(&mut cursor).map(Some) };
        self.at = content.len() - cursor.len();
        self.content = content;
        if let Ok(Some(Decoded::Entry(entry))) = &decoded {
            self.context.follow(entry);
        }
        decoded
    }

    fn decode(&mut self, cursor: &mut Cursor<'_>) -> Result<Decoded, RecordError> {
        let entry = match cursor.u8()? {
            tag::CYCLE => Entry::Cycle(self.cycle(cursor)?),
            tag::DEADLINE => self.deadline(cursor)?,
            tag => {
                let length = cursor.length()?;
                let mut content = Cursor::new(cursor.take(length)?);
                self.past.now = self.past.now.wrapping_add(unzigzag(content.varint()?));
                match other(tag, MonoTime::from_ns(self.past.now), &mut content)? {
                    Some(entry) => entry,
                    None => return Ok(Decoded::Unknown { tag }),
                }
            }
        };
        Ok(Decoded::Entry(entry))
    }

    fn time(&mut self, cursor: &mut Cursor<'_>) -> Result<MonoTime, RecordError> {
        self.past.interval = self.past.interval.wrapping_add(unzigzag(cursor.varint()?));
        self.past.now = self.past.now.wrapping_add(self.past.interval);
        Ok(MonoTime::from_ns(self.past.now))
    }

    fn cycle(&mut self, cursor: &mut Cursor<'_>) -> Result<Cycle, RecordError> {
        let flags = flags(cursor, 0x7f)?;
        let now = self.time(cursor)?;
        let past = &mut self.past;
        past.control_interval = past.control_interval.wrapping_add(unzigzag(cursor.varint()?));
        past.control_ns = past.control_ns.wrapping_add(past.control_interval);
        let step = if flags & bit::STEP != 0 { unzigzag(cursor.varint()?) } else { 0 };
        past.sequence = past.sequence.wrapping_add(step.wrapping_add(1) as u32);
        if flags & bit::MACHINE != 0 {
            past.machine = cursor.u16()?;
        }
        if flags & bit::FEED != 0 {
            past.feed.push(cursor.f64()?);
        }
        let mut answer = self.answer(cursor, flags)?;
        let mut frame = Position {
            sequence: self.past.sequence,
            control_ns: self.past.control_ns,
            state: MachineState::from_bits(self.past.machine),
            feed_mm_per_min: self.past.feed.last(),
            ..Position::default()
        };
        self.numbers(cursor, flags, Some(&mut frame), answer.as_mut())?;
        Ok(Cycle { now, frame, enabled: self.past.status[4] & 2 != 0, answer })
    }

    fn deadline(&mut self, cursor: &mut Cursor<'_>) -> Result<Entry, RecordError> {
        let flags = flags(cursor, bit::ANSWERED | bit::STATUS | bit::WIDE | bit::OTHER)?;
        let now = self.time(cursor)?;
        let mut answer = self.answer(cursor, flags)?;
        self.numbers(cursor, flags, None, answer.as_mut())?;
        Ok(Entry::Deadline { now, enabled: self.past.status[4] & 2 != 0, answer })
    }

    fn answer(&mut self, cursor: &mut Cursor<'_>, flags: u8) -> Result<Option<Answer>, RecordError> {
        if flags & bit::STATUS != 0 {
            self.past.status = cursor.array()?;
            let [state, .., bits] = self.past.status;
            if bits > 3 || CorrectionState::from_code(state).is_none() {
                return Err(RecordError::Value { found: state.max(bits).into() });
            }
        }
        if flags & bit::ANSWERED == 0 {
            return Ok(None);
        }
        let sequence = if flags & bit::OTHER != 0 { cursor.u32()? } else { self.past.sequence };
        answer_of(self.past.status, sequence).map(Some)
    }

    fn numbers(
        &mut self,
        cursor: &mut Cursor<'_>,
        flags: u8,
        frame: Option<&mut Position>,
        answer: Option<&mut Answer>,
    ) -> Result<(), RecordError> {
        let count = if flags & bit::WIDE != 0 { MAX_AXES } else { self.context.axes() };
        let arrays = 3 * usize::from(frame.is_some()) + usize::from(answer.is_some());
        let mut port = Unpacker { control: cursor.take(count * arrays)?, data: cursor };
        if let Some(frame) = frame {
            self.past.arrays(&mut port, frame, count)?;
        }
        if let Some(answer) = answer {
            self.past.offsets(&mut port, &mut answer.offset, count)?;
        }
        Ok(())
    }
}

fn flags(cursor: &mut Cursor<'_>, allowed: u8) -> Result<u8, RecordError> {
    let flags = cursor.u8()?;
    if flags & !allowed == 0 { Ok(flags) } else { Err(RecordError::Value { found: flags.into() }) }
}

/// An entry with its length in front; `None` where its tag is not known.
fn other(tag: u8, now: MonoTime, content: &mut Cursor<'_>) -> Result<Option<Entry>, RecordError> {
    Ok(Some(match tag {
        tag::TOOL => Entry::Tool { now, tool: tool(content)? },
        tag::REQUEST => {
            Entry::Request { now, request: Request { code: content.u8()?, value: content.f64()? } }
        }
        tag::LINK_UP => Entry::LinkUp { now },
        tag::LINK_DOWN => Entry::LinkDown { now },
        tag::ENGINE => Entry::Engine { now, hello: hello(content)? },
        tag::MODEL => Entry::Model { now, hash: content.array()? },
        tag::GAP => Entry::Gap { now, dropped: content.varint()?, context: context(content)? },
        tag::VALUE => Entry::Value { now, channel: content.u16()?, value: content.f64()? },
        _ => return Ok(None),
    }))
}

/// A message in the frame that it has on the link, behind its length.
fn put_message(out: &mut Vec<u8>, message: &Message) {
    let mut frame = [0; MAX_FRAME];
    let length = encode(message, &mut frame);
    put_varint(out, length as u64);
    out.extend_from_slice(&frame[..length]);
}

fn message(cursor: &mut Cursor<'_>) -> Result<Message, RecordError> {
    let length = cursor.length()?;
    decode(cursor.take(length)?).map_err(|_| RecordError::Value { found: length as u64 })
}

fn put_hello(out: &mut Vec<u8>, hello: &ControlHello) {
    put_message(out, &Message::ControlHello(*hello));
}

fn hello(cursor: &mut Cursor<'_>) -> Result<ControlHello, RecordError> {
    match message(cursor)? {
        Message::ControlHello(hello) => Ok(hello),
        _ => Err(RecordError::Value { found: 0 }),
    }
}

fn put_tool(out: &mut Vec<u8>, tool: &Tool) {
    put_message(out, &Message::Tool(*tool));
}

fn tool(cursor: &mut Cursor<'_>) -> Result<Tool, RecordError> {
    match message(cursor)? {
        Message::Tool(tool) => Ok(tool),
        _ => Err(RecordError::Value { found: 0 }),
    }
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

fn context(cursor: &mut Cursor<'_>) -> Result<Context, RecordError> {
    let parts = cursor.u8()?;
    if parts >> 6 != 0 {
        return Err(RecordError::Value { found: parts.into() });
    }
    let has = |k: u8| parts >> k & 1 == 1;
    Ok(Context {
        hello: if has(0) { Some(hello(cursor)?) } else { None },
        link: has(1),
        enabled: has(2),
        gain: if has(3) { Some(cursor.f64()?) } else { None },
        tool: if has(4) { Some(tool(cursor)?) } else { None },
        model: if has(5) { Some(cursor.array()?) } else { None },
    })
}
