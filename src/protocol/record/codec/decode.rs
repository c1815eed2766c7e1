//! Bytes to entries.

use super::{Past, Port, Status, bit, tag, usable};
use crate::record::bytes::{Cursor, unzigzag};
use crate::record::{Answer, Change, Context, Cycle, Entry, LIVE_MAX, RecordError, Request};
use crate::{ControlHello, CorrectionState, MachineState, Message, Position, Tool, decode};
use volcomp_units::MonoTime;
use volcomp_units::axes::MAX_AXES;

/// An entry, or what is known of one that this version does not know.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "nearly every one is an entry")]
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
            tag::LIVE => {
                let told = cursor.u16()?;
                self.live(cursor, told.into())?
            }
            tag::LIVE_MANY => {
                let told = cursor.u32()?;
                self.live(cursor, told)?
            }
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
        let flags = cursor.u8()?;
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
        Ok(Cycle { now, frame, enabled: self.past.enabled(), answer })
    }

    fn deadline(&mut self, cursor: &mut Cursor<'_>) -> Result<Entry, RecordError> {
        let flags = flags(cursor, bit::ANSWERED | bit::STATUS | bit::WIDE | bit::OTHER | bit::CHANGE)?;
        let now = self.time(cursor)?;
        let mut answer = self.answer(cursor, flags)?;
        self.numbers(cursor, flags, None, answer.as_mut())?;
        Ok(Entry::Deadline { now, enabled: self.past.enabled(), answer })
    }

    fn live(&mut self, cursor: &mut Cursor<'_>, told: u32) -> Result<Entry, RecordError> {
        let now = self.time(cursor)?;
        let mut values = [0.0; LIVE_MAX];
        let mut port = Unpacker { control: cursor.take(told.count_ones() as usize)?, data: cursor };
        self.past.live(&mut port, told, &mut values)?;
        Ok(Entry::Live { now, told, values })
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
            // what belongs to an answer only
            let alone = flags & (bit::OTHER | bit::CHANGE);
            return if alone == 0 { Ok(None) } else { Err(RecordError::Value { found: flags.into() }) };
        }
        let sequence = if flags & bit::OTHER != 0 { cursor.u32()? } else { self.past.sequence };
        let change = if flags & bit::CHANGE != 0 {
            Some(Change { from: state(cursor.u8()?)?, cause: cursor.u16()? })
        } else {
            None
        };
        answer_of(self.past.status, sequence, change).map(Some)
    }

    fn numbers(
        &mut self,
        cursor: &mut Cursor<'_>,
        flags: u8,
        frame: Option<&mut Position>,
        answer: Option<&mut Answer>,
    ) -> Result<(), RecordError> {
        let count = if flags & bit::WIDE != 0 { MAX_AXES } else { self.context.axes() };
        let arrays = 3 * usize::from(frame.is_some()) + 2 * usize::from(answer.is_some());
        let mut port = Unpacker { control: cursor.take(count * arrays)?, data: cursor };
        if let Some(frame) = frame {
            self.past.arrays(&mut port, frame, count)?;
        }
        if let Some(answer) = answer {
            self.past.offsets(&mut port, answer, count)?;
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
        _ => return Ok(None),
    }))
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

fn state(code: u8) -> Result<CorrectionState, RecordError> {
    CorrectionState::from_code(code).ok_or(RecordError::Value { found: code.into() })
}

fn answer_of(status: Status, sequence: u32, change: Option<Change>) -> Result<Answer, RecordError> {
    let [code, limited, warning, out_of_range, faded, lag_cycles, flags] = status;
    Ok(Answer {
        sequence,
        state: state(code)?,
        limited,
        warning,
        out_of_range,
        faded,
        lag_cycles,
        stopped: flags & 1 == 1,
        offset: [0.0; MAX_AXES],
        wanted: [0.0; MAX_AXES],
        change,
    })
}

fn message(cursor: &mut Cursor<'_>) -> Result<Message, RecordError> {
    let length = cursor.length()?;
    decode(cursor.take(length)?).map_err(|_| RecordError::Value { found: length as u64 })
}

fn hello(cursor: &mut Cursor<'_>) -> Result<ControlHello, RecordError> {
    match message(cursor)? {
        Message::ControlHello(hello) => Ok(hello),
        _ => Err(RecordError::Value { found: 0 }),
    }
}

fn tool(cursor: &mut Cursor<'_>) -> Result<Tool, RecordError> {
    match message(cursor)? {
        Message::Tool(tool) => Ok(tool),
        _ => Err(RecordError::Value { found: 0 }),
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
