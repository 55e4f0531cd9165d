//! An S3-compatible store of a test's own: SeaweedFS, started from the program of this machine.

use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

/// Names the program, where it is not called `weed` in `PATH`.
const PROGRAM_VARIABLE: &str = "ISOCORTEX_WEED";

/// Where `scripts/weed.sh` puts it.
const FETCHED: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../demo-data/seaweedfs/weed"
);

/// How long it may take to start.
const PATIENCE: Duration = Duration::from_secs(120);

/// The bucket that is there from the start.
pub const BUCKET: &str = "isocortex";

const KEY: &str = "AK";
const SECRET: &str = "SKSKSKSK";

/// The file with the key and the secret.
const CREDENTIALS: &str = "credentials";

/// The text of a file with the key and this secret.
pub(crate) fn credentials(secret: &str) -> String {
    format!("[default]\naws_access_key_id = {KEY}\naws_secret_access_key = {secret}\n")
}

/// A store on this machine. Dropping it ends it.
#[derive(Debug)]
pub struct S3Server {
    folder: TempDir,
    server: Child,
    ports: [u16; 8],
}

impl S3Server {
    /// Starts a store with the [`BUCKET`]; `None`, said aloud, where this machine has no SeaweedFS. That is a failure on CI.
    pub async fn start() -> Option<Self> {
        let Some(program) = program() else {
            let missing = "there is no SeaweedFS: run `scripts/weed.sh`, or name the program in ISOCORTEX_WEED";
            assert!(std::env::var("CI").is_err(), "{missing}");
            eprintln!("SKIPPED: {missing}");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let identities = format!(
            r#"{{"identities":[{{"name":"app","credentials":[{{"accessKey":"{KEY}","secretKey":"{SECRET}"}}],
                "actions":["Admin","Read","Write","List","Tagging"]}}]}}"#
        );
        std::fs::write(folder.path().join("s3.json"), identities).unwrap();
        std::fs::write(folder.path().join(CREDENTIALS), credentials(SECRET)).unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let ports = free_ports();
        let [
            s3,
            s3_grpc,
            master,
            master_grpc,
            volume,
            volume_grpc,
            filer,
            filer_grpc,
        ] = ports;
        let server = Command::new(program)
            .current_dir(folder.path())
            .args(["server", "-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-dir=data"])
            .args([
                "-master.volumeSizeLimitMB=64",
                "-volume.max=200",
                "-s3",
                "-s3.config=s3.json",
            ])
            .args([
                "-master.telemetry=false",
                "-s3.port.iceberg=0",
                "-s3.port.lance=0",
            ])
            .args(["-filer.localSocket=filer.sock", "-s3.localSocket=s3.sock"])
            .args([format!("-s3.port={s3}"), format!("-s3.port.grpc={s3_grpc}")])
            .args([
                format!("-master.port={master}"),
                format!("-master.port.grpc={master_grpc}"),
            ])
            .args([
                format!("-volume.port={volume}"),
                format!("-volume.port.grpc={volume_grpc}"),
            ])
            .args([
                format!("-filer.port={filer}"),
                format!("-filer.port.grpc={filer_grpc}"),
            ])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let server = Self {
            folder,
            server,
            ports,
        };
        server.make_bucket().await;
        Some(server)
    }

    /// The `AWS_…` variables of a process that is to use it.
    pub fn variables(&self) -> [(&'static str, String); 2] {
        let credentials = self.folder.path().join(CREDENTIALS);
        [
            (
                "AWS_ENDPOINT_URL",
                format!("http://127.0.0.1:{}", self.ports[0]),
            ),
            (
                "AWS_SHARED_CREDENTIALS_FILE",
                credentials.display().to_string(),
            ),
        ]
    }

    /// Ends it at once, as a fault would.
    pub fn stop(&mut self) {
        if self.server.try_wait().unwrap().is_none() {
            self.server.kill().unwrap();
            self.server.wait().unwrap();
        }
    }

    /// A bucket is a folder of its file server, to be had once all its parts have found each other.
    async fn make_bucket(&self) {
        let begun = Instant::now();
        while !self.tries_to_make_bucket().await.is_ok_and(|made| made) {
            assert!(begun.elapsed() < PATIENCE, "SeaweedFS does not start");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    async fn tries_to_make_bucket(&self) -> std::io::Result<bool> {
        // The address for S3 opens last.
        tokio::net::TcpStream::connect(("127.0.0.1", self.ports[0])).await?;
        let mut connection = tokio::net::TcpStream::connect(("127.0.0.1", self.ports[6])).await?;
        let request = format!(
            "POST /buckets/{BUCKET}/ HTTP/1.1\r\nHost: filer\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
        );
        connection.write_all(request.as_bytes()).await?;
        let mut answer = String::new();
        connection.read_to_string(&mut answer).await?;
        Ok(answer.starts_with("HTTP/1.1 2"))
    }
}

impl Drop for S3Server {
    fn drop(&mut self) {
        self.stop();
        // It leaves sockets there, named after its ports.
        for port in self.ports {
            for name in ["master-grpc", "volume-grpc", "filer-grpc", "s3-grpc"] {
                let _absent = std::fs::remove_file(format!("/tmp/seaweedfs-{name}-{port}.sock"));
            }
        }
        let _ = self.folder.path();
    }
}

/// Ports that were free a moment ago.
fn free_ports() -> [u16; 8] {
    let listeners = [(); 8].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    listeners.map(|listener| listener.local_addr().unwrap().port())
}

fn program() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(PROGRAM_VARIABLE) {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let in_path = std::env::split_paths(&path).map(|folder| folder.join("weed"));
    in_path.chain([FETCHED.into()]).find(|file| file.is_file())
}
