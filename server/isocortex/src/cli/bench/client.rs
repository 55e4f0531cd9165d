//! A connection to the server that is measured.

use std::net::SocketAddr;
use std::time::Instant;

use bytes::Bytes;
use http_body_util::{BodyExt as _, Empty};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::{Request, StatusCode, header};
use hyper_util::rt::TokioIo;
use tokio::net::TcpStream;

use crate::cli::status::{CliError, ExitStatus};

/// A connection that is kept.
#[derive(Debug)]
pub(super) struct Client {
    sender: SendRequest<Empty<Bytes>>,
    host: String,
}

/// An answer, read to its end.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    pub(super) status: StatusCode,
    /// Bytes of its body.
    pub(super) length: usize,
    /// Time from the request to the body's last byte, in seconds.
    pub(super) seconds: f64,
}

impl Client {
    /// Connects.
    pub(super) async fn connect(address: SocketAddr) -> Result<Self, CliError> {
        let stream = TcpStream::connect(address).await.map_err(unreachable)?;
        stream.set_nodelay(true).map_err(unreachable)?;
        let (sender, connection) = handshake(TokioIo::new(stream)).await.map_err(unreachable)?;
        // How it ends shows in the requests.
        tokio::spawn(connection);
        Ok(Self {
            sender,
            host: address.to_string(),
        })
    }

    /// Asks, and reads the whole answer.
    pub(super) async fn get(&mut self, path: &str) -> Result<Answer, CliError> {
        let request = self.request(path)?;
        let begin = Instant::now();
        self.sender.ready().await.map_err(unreachable)?;
        let response = self.sender.send_request(request).await;
        let response = response.map_err(unreachable)?;
        let status = response.status();
        let mut body = response.into_body();
        let mut length = 0;
        while let Some(frame) = body.frame().await {
            length += frame.map_err(unreachable)?.data_ref().map_or(0, Bytes::len);
        }
        Ok(Answer {
            status,
            length,
            seconds: begin.elapsed().as_secs_f64(),
        })
    }

    /// Asks for JSON.
    pub(super) async fn get_json(&mut self, path: &str) -> Result<serde_json::Value, CliError> {
        let request = self.request(path)?;
        self.sender.ready().await.map_err(unreachable)?;
        let response = self.sender.send_request(request).await;
        let body = response.map_err(unreachable)?.into_body().collect().await;
        let bytes = body.map_err(unreachable)?.to_bytes();
        serde_json::from_slice(&bytes).map_err(unreachable)
    }

    fn request(&self, path: &str) -> Result<Request<Empty<Bytes>>, CliError> {
        Request::get(path)
            .header(header::HOST, &self.host)
            .body(Empty::new())
            .map_err(unreachable)
    }

    /// As [`Client::get`]; any other answer than 200 is an error.
    pub(super) async fn get_ok(&mut self, path: &str) -> Result<Answer, CliError> {
        let answer = self.get(path).await?;
        if answer.status == StatusCode::OK {
            return Ok(answer);
        }
        let message = format!("the server answered {} to {path}", answer.status);
        Err(CliError::new(ExitStatus::Unavailable, message))
    }
}

fn unreachable(error: impl std::fmt::Display) -> CliError {
    let message = format!("the server cannot be reached: {error}");
    CliError::new(ExitStatus::Unavailable, message)
}
