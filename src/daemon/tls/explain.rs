//! What went wrong between two ends that speak TLS, in words, with what to do about it.

use core::fmt;
use std::io;

use rustls::{AlertDescription, CertificateError, Error, InvalidMessage};

/// Why there is no secure link.
#[derive(Debug, Clone)]
pub(crate) struct TlsError(Error);

impl TlsError {
    /// The failure of TLS behind a failure of the stream, where there is one.
    pub(crate) fn of(error: &io::Error) -> Option<Self> {
        error.get_ref()?.downcast_ref::<Error>().cloned().map(Self)
    }

    /// True where waiting does not help: certificates do not change by themselves, but the clock goes on.
    pub(crate) const fn needs_a_person(&self) -> bool {
        matches!(self.0, Error::InvalidCertificate(_) | Error::AlertReceived(_) | Error::InvalidMessage(_))
    }
}

impl core::error::Error for TlsError {}

impl fmt::Display for TlsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Error::InvalidCertificate(why) => certificate(f, why),
            Error::AlertReceived(alert) => refused(f, *alert),
            Error::InvalidMessage(InvalidMessage::InvalidContentType) => f.write_str(
                "the control does not speak TLS: switch TLS on at the control, or take [link.tls] out of the machine \
                 file",
            ),
            other => write!(f, "TLS failed: {other}"),
        }
    }
}

/// The control's certificate, as this daemon judges it.
fn certificate(f: &mut fmt::Formatter<'_>, why: &CertificateError) -> fmt::Result {
    use CertificateError as Why;
    match why {
        Why::UnknownIssuer | Why::BadSignature => f.write_str(
            "the control's certificate was not issued by an authority in link.tls.ca: name the file of the authority \
             that issued it, or give the control a certificate of this one",
        ),
        Why::Expired => expired(f, None),
        Why::ExpiredContext { time, not_after } => {
            expired(f, Some(time.as_secs().saturating_sub(not_after.as_secs())))
        }
        Why::NotValidYet | Why::NotValidYetContext { .. } => f.write_str(
            "the control's certificate is not valid yet: set the clock of this computer, or wait until it is valid",
        ),
        Why::NotValidForName => f.write_str(
            "the control's certificate does not carry the name link.tls.server-name: write a name that it carries",
        ),
        Why::NotValidForNameContext { expected, presented } => {
            write!(f, "the control's certificate is not for \"{}\" but for ", expected.to_str())?;
            match presented.is_empty() {
                true => f.write_str("no name at all")?,
                false => f.write_str(&presented.join(", "))?,
            }
            f.write_str(": correct link.tls.server-name, or give the control a certificate with that name")
        }
        Why::InvalidPurpose | Why::InvalidPurposeContext { .. } => f.write_str(
            "the control's certificate is not one for a server: give it one with the extended key usage serverAuth",
        ),
        other => write!(f, "the control's certificate is not usable: {other}"),
    }
}

fn expired(f: &mut fmt::Formatter<'_>, since_s: Option<u64>) -> fmt::Result {
    f.write_str("the control's certificate has expired")?;
    if let Some(since_s) = since_s {
        write!(f, " {} days ago", since_s / 86_400)?;
    }
    f.write_str(": give the control a new one (or set the clock of this computer)")
}

/// What the control says about this daemon.
fn refused(f: &mut fmt::Formatter<'_>, alert: AlertDescription) -> fmt::Result {
    use AlertDescription as Alert;
    let why = match alert {
        Alert::UnknownCA | Alert::DecryptError => {
            "as not issued by an authority that it knows: give the daemon a certificate of the control's authority"
        }
        Alert::CertificateExpired => {
            "as expired or not valid yet: give the daemon a new one, and look at the control's clock"
        }
        Alert::CertificateRequired => "because it was shown none: check link.tls.certificate",
        Alert::CertificateRevoked => "as revoked: give the daemon a new one",
        Alert::UnsupportedCertificate => {
            "as not one for a client: give the daemon one with the extended key usage clientAuth"
        }
        Alert::BadCertificate | Alert::CertificateUnknown | Alert::AccessDenied => {
            "for a reason of its own: read the log of the control"
        }
        Alert::ProtocolVersion | Alert::HandshakeFailure => {
            return f
                .write_str("the control has no version or cipher of TLS in common: it must speak TLS 1.3");
        }
        Alert::UnrecognisedName => {
            return f
                .write_str("the control does not know the name link.tls.server-name: write one that it has");
        }
        other => return write!(f, "the control ended TLS with the alert {other:?}: read its log"),
    };
    write!(f, "the control refuses this daemon's certificate {why}")
}
