//! A program without the feature `tls`: nothing of this can ever exist.

use core::fmt;
use std::io;

use super::TlsFileError;
use crate::config::TlsConfig;

/// An identity that cannot be had.
#[derive(Debug, Clone)]
pub enum Identity {}

impl Identity {
    pub(super) fn read(_: &TlsConfig) -> Result<Self, TlsFileError> {
        Err(TlsFileError::NotBuilt)
    }
}

/// A failure that cannot happen.
#[derive(Debug)]
pub(in crate::runtime) enum TlsError {}

impl TlsError {
    pub(in crate::runtime) const fn of(_: &io::Error) -> Option<Self> {
        None
    }

    pub(in crate::runtime) const fn needs_a_person(&self) -> bool {
        match *self {}
    }
}

impl fmt::Display for TlsError {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

impl core::error::Error for TlsError {}

/// A stream that cannot be had.
#[derive(Debug)]
pub(in crate::runtime) enum TlsStream {}

impl TlsStream {
    pub(in crate::runtime) fn start(identity: &Identity) -> io::Result<Self> {
        match *identity {}
    }

    pub(in crate::runtime) fn shake(&mut self, _: &mut (impl io::Read + io::Write)) -> io::Result<bool> {
        match *self {}
    }

    pub(in crate::runtime) const fn has_more(&self) -> bool {
        match *self {}
    }

    pub(in crate::runtime) fn read(
        &mut self,
        _: &mut (impl io::Read + io::Write),
        _: &mut [u8],
    ) -> io::Result<usize> {
        match *self {}
    }

    pub(in crate::runtime) fn write_all(&mut self, _: &mut impl io::Write, _: &[u8]) -> io::Result<()> {
        match *self {}
    }

    pub(in crate::runtime) fn close(&mut self, _: &mut impl io::Write) {
        match *self {}
    }
}
