//! The token that commands need: read once at the start, compared in constant time, wrong ones limited in rate.

use core::fmt;
use core::net::{IpAddr, Ipv6Addr};
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use volcomp_config::{HttpConfig, MachineConfig};
use volcomp_state::bounded_read::read_open;
use volcomp_units::MonoTime;

use crate::private_file::{self, Exposed};

/// Length of a token, characters.
const LENGTH: core::ops::RangeInclusive<usize> = 32..=256;
/// Largest file, bytes.
const BYTES_MAX: u64 = 1 << 10;

/// Wrong tokens that one address may show in a row.
const BURST: f64 = 5.0;
/// Wrong tokens that are forgiven per second.
const FORGIVEN_PER_S: f64 = 0.1;
/// Addresses that are remembered.
const ADDRESSES: usize = 256;
/// Bits of an IPv6 address that a network of one owner has in common.
const PREFIX: u32 = 64;

/// Why commands by HTTP cannot be offered. No message shows a character of the token.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// It cannot be read.
    #[error("http.token-file: {}: {source}\n  hint: the path is seen from the machine file", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Others may read it.
    #[error(
        "http.token-file: {}: its mode is {mode:04o}, so others may read or change the token\n  hint: chmod {allowed:04o} {}",
        path.display(), path.display()
    )]
    Exposed {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
        /// The most it may have.
        allowed: u32,
    },
    /// It is no token.
    #[error(
        "http.token-file: {}: {what}, expected one line of {} to {} printable ASCII characters without spaces\n  \
         hint: make one with `openssl rand -hex 32`", path.display(), LENGTH.start(), LENGTH.end()
    )]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

impl TokenError {
    /// Whether the file could not be read at all.
    #[must_use]
    pub const fn is_io(&self) -> bool {
        matches!(self, Self::Read { .. })
    }
}

/// The token, as its BLAKE3: the token itself is not kept.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(blake3::Hash);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

/// The token of a machine file, where it names one.
///
/// # Errors
/// The file cannot be read, is open to others, or holds no token.
pub fn http_token(config: &Path, machine: &MachineConfig) -> Result<Option<Token>, TokenError> {
    Token::of(config, &machine.http)
}

impl Token {
    /// The token that `[http]` names, seen from the machine file.
    pub(crate) fn of(config: &Path, http: &HttpConfig) -> Result<Option<Self>, TokenError> {
        let path = http.token_file.as_ref().filter(|_| http.listen.is_some());
        path.map(|path| Self::read(&config.with_file_name(path))).transpose()
    }

    fn read(path: &Path) -> Result<Self, TokenError> {
        let failed = |source| TokenError::Read { path: path.to_owned(), source };
        let file = File::open(path).map_err(failed)?;
        // by the open handle: what is judged is what is read
        private_file::check(&file.metadata().map_err(failed)?).map_err(|Exposed { mode, allowed }| {
            TokenError::Exposed { path: path.to_owned(), mode, allowed }
        })?;
        let bytes = read_open(&file, BYTES_MAX).map_err(failed)?;
        let token = bytes.strip_suffix(b"\n").unwrap_or(&bytes);
        let token = token.strip_suffix(b"\r").unwrap_or(token);
        let unusable = |what: String| TokenError::Unusable { path: path.to_owned(), what };
        if let Some(at) = token.iter().position(|c| !c.is_ascii_graphic()) {
            return Err(unusable(format!("byte {at} is not a printable character")));
        }
        if !LENGTH.contains(&token.len()) {
            return Err(unusable(format!("{} characters", token.len())));
        }
        Ok(Self(blake3::hash(token)))
    }

    /// Whether a client has shown it. The time says nothing about the token: two hashes are compared, in constant time.
    pub(super) fn is(&self, shown: &[u8]) -> bool {
        self.0 == blake3::hash(shown)
    }
}

/// Wrong tokens by address.
#[derive(Debug, Default)]
pub(super) struct WrongTokens {
    clients: BTreeMap<IpAddr, (f64, MonoTime)>,
}

impl WrongTokens {
    /// Time until another token of this address is looked at, s; `None`: now.
    pub(super) fn wait_s(&self, now: MonoTime, client: IpAddr) -> Option<f64> {
        let excess = self.standing(now, network(client)) - (BURST - 1.0);
        (excess > 0.0).then_some(excess / FORGIVEN_PER_S)
    }

    /// A wrong one.
    pub(super) fn record(&mut self, now: MonoTime, client: IpAddr) {
        let client = network(client);
        let count = self.standing(now, client) + 1.0;
        if self.clients.len() >= ADDRESSES && !self.clients.contains_key(&client) {
            let mildest = self
                .clients
                .keys()
                .copied()
                .min_by(|a, b| self.standing(now, *a).total_cmp(&self.standing(now, *b)));
            if let Some(mildest) = mildest {
                self.clients.remove(&mildest);
            }
        }
        self.clients.insert(client, (count, now));
    }

    /// Wrong ones that are not forgiven yet.
    fn standing(&self, now: MonoTime, network: IpAddr) -> f64 {
        let Some((count, at)) = self.clients.get(&network) else { return 0.0 };
        (count - now.seconds_since(*at) * FORGIVEN_PER_S).max(0.0)
    }
}

/// The address, or the network of an IPv6 one, whose owner has all of its addresses.
fn network(client: IpAddr) -> IpAddr {
    match client.to_canonical() {
        IpAddr::V6(address) => {
            let mask = u128::MAX << (u128::BITS - PREFIX);
            IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() & mask))
        }
        address @ IpAddr::V4(_) => address,
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn read(content: &str, mode: u32) -> Result<Token, String> {
        let dir = tempfile::tempdir().expect("directory");
        let path = dir.path().join("token");
        std::fs::write(&path, content).expect("written");
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).expect("set");
        Token::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn a_token_that_others_may_read_or_that_is_short_is_refused() {
        let good = "0123456789abcdef0123456789abcdef";
        let token = read(&format!("{good}\n"), 0o600).expect("a token");
        assert!(token.is(good.as_bytes()) && !format!("{token:?}").contains("0123"));
        for wrong in ["", "0123456789abcdef0123456789abcde", "0123456789abcdef0123456789abcdef\n"] {
            assert!(!token.is(wrong.as_bytes()), "{wrong}");
        }
        for (content, mode, words) in [
            (good, 0o604, "its mode is 0604"),
            (good, 0o602, "chmod"),
            (&good[1..], 0o600, "31 characters, expected one line of 32 to 256"),
            ("", 0o600, "0 characters"),
            (&format!("{good}\n{good}\n"), 0o600, "byte 32 is not a printable character"),
            (&"x".repeat(257), 0o600, "257 characters"),
            (&"x".repeat(5000), 0o600, "the limit is 1024 bytes"),
        ] {
            let error = read(content, mode).expect_err(words);
            assert!(error.contains(words) && !error.contains("0123456789"), "{error}");
        }
        let missing = Token::read(Path::new("/nonexistent/token")).expect_err("missing");
        assert!(missing.is_io());
    }

    #[test]
    fn wrong_tokens_are_limited_by_address_and_forgiven_with_time() {
        let at = |s: f64| MonoTime::ZERO.plus_seconds(s);
        let client: IpAddr = "10.0.0.5".parse().expect("address");
        let mut wrong = WrongTokens::default();
        for k in 0..5 {
            assert_eq!(wrong.wait_s(at(0.0), client), None, "{k}");
            wrong.record(at(0.0), client);
        }
        assert_eq!(wrong.wait_s(at(0.0), client), Some(10.0));
        assert_eq!(wrong.wait_s(at(10.0), client), None, "one is forgiven");
        wrong.record(at(10.0), client);
        assert!(wrong.wait_s(at(11.0), client).is_some_and(|s| s > 8.0));
        // another address is not kept waiting, the same network of IPv6 is
        let [a, b, c] =
            ["2001:db8::1", "2001:db8::2", "2001:db8:0:1::1"].map(|a| a.parse().expect("address"));
        assert_eq!(wrong.wait_s(at(11.0), a), None);
        for _ in 0..6 {
            wrong.record(at(11.0), a);
        }
        assert!(wrong.wait_s(at(11.0), b).is_some() && wrong.wait_s(at(11.0), c).is_none());
        // memory is bounded, and the worst stay known
        for k in 0..10_000_u32 {
            wrong.record(at(11.0), IpAddr::V4(k.into()));
        }
        assert_eq!(wrong.clients.len(), ADDRESSES);
        assert!(wrong.wait_s(at(11.0), b).is_some());
    }
}
