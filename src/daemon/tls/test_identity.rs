//! The control's end of a link in tests of the cycle: plain, or over TLS with certificates made on the spot.

use std::io::{self, Read, Write};
use std::net::TcpStream;

#[cfg(feature = "tls")]
pub(crate) use with_tls::{Server, TestIdentity, Wire};
#[cfg(not(feature = "tls"))]
pub(crate) use without_tls::{Server, TestIdentity, Wire};

#[cfg(feature = "tls")]
mod with_tls {
    use std::path::{Path, PathBuf};
    use std::sync::Arc;

    use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair};
    use rustls::crypto::ring::default_provider;
    use rustls::pki_types::PrivateKeyDer;
    use rustls::server::WebPkiClientVerifier;
    use rustls::{RootCertStore, ServerConfig, ServerConnection};
    use tempfile::TempDir;

    use super::{Read, TcpStream, Write, io};
    use crate::tls::Identity;
    use volcomp_config::TlsConfig;

    pub(crate) type Server = Arc<ServerConfig>;

    /// An authority with both ends' certificates.
    pub(crate) struct TestIdentity {
        folder: TempDir,
        server: Server,
    }

    impl TestIdentity {
        pub(crate) fn new() -> Self {
            let mut params = CertificateParams::new(Vec::new()).expect("parameters");
            params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
            let key = KeyPair::generate().expect("key");
            let authority = CertifiedIssuer::self_signed(params, key).expect("authority");
            let issue = |name: &str| {
                let params = CertificateParams::new(vec![name.to_owned()]).expect("parameters");
                let key = KeyPair::generate().expect("key");
                (params.signed_by(&key, &authority).expect("certificate"), key)
            };
            let folder = tempfile::tempdir().expect("folder");
            let (certificate, key) = issue("volcompd");
            put(&folder.path().join("ca.pem"), &authority.pem());
            put(&folder.path().join("daemon.pem"), &certificate.pem());
            put(&folder.path().join("daemon.key"), &key.serialize_pem());
            let mut roots = RootCertStore::empty();
            roots.add(authority.der().clone()).expect("root");
            let provider = Arc::new(default_provider());
            let verifier =
                WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider));
            let (certificate, key) = issue("control");
            let server = ServerConfig::builder_with_provider(provider)
                .with_protocol_versions(&[&rustls::version::TLS13])
                .expect("version")
                .with_client_cert_verifier(verifier.build().expect("verifier"))
                .with_single_cert(
                    vec![certificate.der().clone()],
                    PrivateKeyDer::Pkcs8(key.serialize_der().into()),
                )
                .expect("certificate");
            Self { folder, server: Arc::new(server) }
        }

        pub(crate) fn server(&self) -> Server {
            Arc::clone(&self.server)
        }

        pub(crate) fn identity(&self) -> Identity {
            let file = |name: &str| -> PathBuf { self.folder.path().join(name) };
            let tls = TlsConfig {
                ca: file("ca.pem"),
                certificate: file("daemon.pem"),
                key: file("daemon.key"),
                server_name: "control".to_owned(),
            };
            Identity::read(&tls).expect("an identity")
        }
    }

    fn put(path: &Path, text: &str) {
        use std::os::unix::fs::OpenOptionsExt;
        let mut file =
            std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(path).expect("file");
        file.write_all(text.as_bytes()).expect("written");
    }

    /// The bytes of the control's end.
    pub(crate) struct Wire {
        stream: TcpStream,
        tls: Option<ServerConnection>,
    }

    impl Wire {
        pub(crate) fn new(stream: TcpStream, server: Option<Server>) -> Self {
            Self { stream, tls: server.map(|server| ServerConnection::new(server).expect("a connection")) }
        }

        pub(crate) const fn stream(&self) -> &TcpStream {
            &self.stream
        }

        pub(crate) fn read(&mut self, space: &mut [u8]) -> io::Result<usize> {
            match &mut self.tls {
                None => self.stream.read(space),
                Some(tls) => rustls::Stream::new(tls, &mut self.stream).read(space),
            }
        }

        pub(crate) fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
            match &mut self.tls {
                None => self.stream.write_all(bytes),
                Some(tls) => rustls::Stream::new(tls, &mut self.stream).write_all(bytes),
            }
        }
    }
}

#[cfg(not(feature = "tls"))]
mod without_tls {
    use super::{Read, TcpStream, Write, io};
    use crate::tls::Identity;

    /// Never there.
    pub(crate) enum Server {}

    /// Never there.
    pub(crate) enum TestIdentity {}

    impl TestIdentity {
        pub(crate) fn new() -> Self {
            unreachable!("a program without TLS")
        }

        pub(crate) const fn server(&self) -> Server {
            match *self {}
        }

        pub(crate) const fn identity(&self) -> Identity {
            match *self {}
        }
    }

    /// The bytes of the control's end.
    pub(crate) struct Wire(TcpStream);

    impl Wire {
        pub(crate) fn new(stream: TcpStream, _: Option<Server>) -> Self {
            Self(stream)
        }

        pub(crate) const fn stream(&self) -> &TcpStream {
            &self.0
        }

        pub(crate) fn read(&mut self, space: &mut [u8]) -> io::Result<usize> {
            self.0.read(space)
        }

        pub(crate) fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
            self.0.write_all(bytes)
        }
    }
}
