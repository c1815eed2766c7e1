//! A program without the feature `tls`: nothing of this can ever exist.

use std::io;

use super::TlsFileError;
use volcomp_config::TlsConfig;

/// An identity that cannot be had.
#[derive(Debug, Clone)]
pub enum Identity {}

impl Identity {
    pub(super) fn read(_: &TlsConfig) -> Result<Self, TlsFileError> {
        Err(TlsFileError::NotBuilt)
    }
}

/// A failure that cannot happen.
#[derive(Debug, thiserror::Error)]
pub(crate) enum TlsError {}

impl TlsError {
    pub(crate) const fn of(_: &io::Error) -> Option<Self> {
        None
    }

    pub(crate) const fn needs_a_person(&self) -> bool {
        match *self {}
    }
}

/// A stream that cannot be had.
#[derive(Debug)]
pub(crate) enum TlsStream {}

impl TlsStream {
    pub(crate) fn start(identity: &Identity) -> io::Result<Self> {
        match *identity {}
    }

    pub(crate) fn shake(&mut self, _: &mut (impl io::Read + io::Write)) -> io::Result<bool> {
        match *self {}
    }

    pub(crate) const fn has_more(&self) -> bool {
        match *self {}
    }

    pub(crate) fn read(&mut self, _: &mut (impl io::Read + io::Write), _: &mut [u8]) -> io::Result<usize> {
        match *self {}
    }

    pub(crate) fn write_all(&mut self, _: &mut impl io::Write, _: &[u8]) -> io::Result<()> {
        match *self {}
    }

    pub(crate) fn close(&mut self, _: &mut impl io::Write) {
        match *self {}
    }
}
