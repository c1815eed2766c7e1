//! The measuring end of the link.

use core::time::Duration;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};

use anyhow::{Context, bail};

use super::{About, Answer, LINE_MAX, Measured, Point, Request, Want};

/// Patience with a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// Patience with a run: a measurement in real time takes minutes.
const RUN: Duration = Duration::from_secs(3 * 3600);

/// A running pair of control and daemon.
#[derive(Debug)]
pub struct Remote {
    about: About,
    reader: BufReader<TcpStream>,
}

impl Remote {
    /// Connects to `cncsim serve --measure`.
    ///
    /// # Errors
    /// Nobody listens there, or somebody else does.
    pub fn connect(address: &str) -> anyhow::Result<Self> {
        let found = address
            .to_socket_addrs()
            .with_context(|| format!("{address} is neither a file nor HOST:PORT"))?
            .next()
            .with_context(|| format!("{address} has no address"))?;
        let stream = TcpStream::connect_timeout(&found, CONNECT).with_context(|| {
            format!("nobody listens on {address}; start a control with cncsim serve --measure {address}")
        })?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(CONNECT))?;
        let mut reader = BufReader::new(stream);
        let about = line(&mut reader)
            .and_then(|text| Ok(serde_json::from_str(&text)?))
            .with_context(|| format!("{address} is no measuring port of cncsim serve"))?;
        reader.get_ref().set_read_timeout(Some(RUN))?;
        Ok(Self { about, reader })
    }
}

impl Measured for Remote {
    fn about(&self) -> &About {
        &self.about
    }

    fn run(&mut self, program: &str, want: Want) -> anyhow::Result<Vec<Point>> {
        let request = Request { program: program.to_owned(), want };
        let text = serde_json::to_string(&request)? + "\n";
        self.reader.get_mut().write_all(text.as_bytes()).context("the control is gone")?;
        match serde_json::from_str(&line(&mut self.reader)?).context("answer of the control")? {
            Answer::Points(points) => Ok(points),
            Answer::Error(why) => bail!("the control refuses: {why}"),
        }
    }
}

fn line(reader: &mut BufReader<TcpStream>) -> anyhow::Result<String> {
    let mut text = String::new();
    if reader.take(LINE_MAX).read_line(&mut text)? == 0 {
        bail!("the control has closed the connection");
    }
    Ok(text)
}
