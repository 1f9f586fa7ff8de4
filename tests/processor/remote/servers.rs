//! Servers of others, where they are installed: nginx, Caddy, and Moto, which speaks S3. Where one is not, standard error says how to install
//! it, and it is not tried (docs/developing.md).

use super::{in_memory, some_page, sound, without_keys};
use crate::support::program;
use deepfield::store::{PageFile, PageId};
use std::fs::File;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, UNIX_EPOCH};
use tempfile::TempDir;

/// Tells of a server that is not installed.
fn not_tried(server: &str, install: &str) {
    eprintln!("skipped: {server} is not installed, and not tried: {install}");
}

/// A server of a folder of its own; it ends when it is dropped.
struct Server {
    child: Child,
    address: SocketAddr,
    folder: TempDir,
}

impl Server {
    /// Starts the first of these programs that is there, as `command` has it for a folder and an address; none where none is, which is told
    /// with what installs it.
    fn start(programs: &[&str], install: &str, command: impl Fn(&str, &Path, SocketAddr) -> Command) -> Option<Server> {
        let program = programs.iter().find(|program| {
            let asked = Command::new(program).arg("-h").stdin(Stdio::null()).output();
            !asked.is_err_and(|error| error.kind() == ErrorKind::NotFound)
        });
        let Some(program) = program else {
            not_tried(programs[0], install);
            return None;
        };
        // Somebody else may take the port before the server does.
        for _ in 0..3 {
            let folder = tempfile::tempdir().unwrap();
            std::fs::create_dir(folder.path().join("files")).unwrap();
            let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
            let log = File::create(folder.path().join("log")).unwrap();
            let mut command = command(program, folder.path(), address);
            command.stdin(Stdio::null()).stdout(log.try_clone().unwrap()).stderr(log);
            let mut server = Server { child: command.spawn().unwrap(), address, folder };
            if server.listens() {
                return Some(server);
            }
            eprintln!("{program}: {}", std::fs::read_to_string(server.folder.path().join("log")).unwrap_or_default());
        }
        panic!("{program} does not start");
    }

    /// Waits until it listens, or has ended.
    fn listens(&mut self) -> bool {
        let end = Instant::now() + Duration::from_secs(30);
        while Instant::now() < end && self.child.try_wait().unwrap().is_none() {
            if TcpStream::connect(self.address).is_ok() {
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
    }

    fn url(&self, name: &str) -> String {
        format!("http://{}/{name}", self.address)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// nginx, which compresses what it sends to whoever takes that.
fn nginx() -> Option<Server> {
    Server::start(&["nginx", "/usr/sbin/nginx"], "apt-get install nginx-light", |program, folder, address| {
        let paths: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .iter()
            .map(|name| format!("    {name}_temp_path {name};\n"))
            .collect();
        // Paths are those of the folder.
        let text = format!(
            "daemon off;\nmaster_process off;\npid pid;\nerror_log error.log;\nevents {{ worker_connections 64; }}\n\
             http {{\n    access_log off;\n{paths}    gzip on;\n    gzip_types *;\n    gzip_min_length 0;\n    gzip_proxied any;\n    \
             server {{ listen {address}; root files; }}\n}}\n"
        );
        let path = folder.join("nginx.conf");
        std::fs::write(&path, text).unwrap();
        let mut command = Command::new(program);
        command.arg("-p").arg(folder).arg("-c").arg(path).arg("-e").arg(folder.join("error.log"));
        command
    })
}

/// Caddy's server of files, which does the same.
fn caddy() -> Option<Server> {
    Server::start(&["caddy"], "apt-get install caddy", |program, folder, address| {
        let (host, files) = (address.ip(), folder.join("files"));
        let text = format!(
            "{{\n    admin off\n    auto_https off\n}}\nhttp://{address} {{\n    bind {host}\n    root * {files:?}\n    encode gzip\n    \
             file_server\n}}\n"
        );
        let path = folder.join("Caddyfile");
        std::fs::write(&path, text).unwrap();
        let mut command = Command::new(program);
        command.args(["run", "--adapter", "caddyfile", "--config"]).arg(path);
        command.envs(["HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"].map(|name| (name, folder)));
        command
    })
}

/// The Python that has Moto, if there is one.
fn python() -> PathBuf {
    std::env::var_os("DEEPFIELD_TEST_PYTHON").map_or_else(|| "python3".into(), PathBuf::from)
}

/// Moto, which asks nobody who he is before it is told to.
fn moto() -> Option<Server> {
    let python = python();
    let asked = Command::new(&python).args(["-c", "import boto3, moto.server"]).stdin(Stdio::null()).output();
    let install = format!("{} -m pip install 'moto[server]' boto3", python.display());
    if !asked.is_ok_and(|output| output.status.success()) {
        not_tried("moto[server]", &install);
        return None;
    }
    Server::start(&[python.to_str().unwrap()], &install, |program, _, address| {
        let mut command = Command::new(program);
        let (host, port) = (address.ip().to_string(), address.port().to_string());
        command.args(["-m", "moto.server", "-H", &host, "-p", &port]).env("INITIAL_NO_AUTH_ACTION_COUNT", "1000000");
        command
    })
}

/// Writes a file that was changed so many seconds after the beginning of 1970: servers tell versions by the second.
fn write(path: &Path, bytes: &[u8], seconds: u64) {
    std::fs::write(path, bytes).unwrap();
    let file = File::options().write(true).open(path).unwrap();
    file.set_modified(UNIX_EPOCH + Duration::from_secs(seconds)).unwrap();
}

#[test]
fn servers_of_others_give_every_page_as_it_is_and_another_version_is_told() {
    let other: Vec<u8> = sound().iter().map(|byte| byte ^ 0x5a).collect();
    for server in [nginx(), caddy()].into_iter().flatten() {
        let (path, url) = (server.folder.path().join("files/sound.df"), server.url("sound.df"));
        write(&path, sound(), 1_000_000_000);
        let (file, local) = (PageFile::open(Path::new(&url)).unwrap(), in_memory(sound()));
        assert_eq!(file.metadata(), local.metadata());
        for page in (0..file.page_count()).map(PageId) {
            let [there, here] = [&file, &*local].map(|file| file.fetch_page(page).unwrap());
            assert!(there.bytes() == here.bytes(), "{url}: page {}", page.0);
        }
        write(&path, &other, 1_000_000_007);
        let told = file.read_page(some_page(&file)).unwrap_err().to_string();
        assert!(told.contains("replaced"), "{told}");
        let told = PageFile::open(Path::new(&server.url("absent.df"))).unwrap_err().to_string();
        assert!(told.ends_with("127.0.0.1 has no such file (status 404)"), "{told}");
    }
}

/// How Python talks to Moto: the first argument is its URL.
const CLIENT: &str = r#"
import boto3, json, sys, urllib.request
def client(service):
    keys = dict(aws_access_key_id="a", aws_secret_access_key="b")
    return boto3.client(service, endpoint_url=sys.argv[1], region_name="us-east-1", **keys)
def put(key, **more):
    with open(sys.argv[2], "rb") as file:
        client("s3").put_object(Bucket="data", Key=key, Body=file, **more)
"#;
/// Puts the file that the second argument names into a bucket, and prints the keys of a user who may read it.
const SET_UP: &str = r#"
client("s3").create_bucket(Bucket="data")
put("private.df")
put("public.df", ACL="public-read")
iam = client("iam")
iam.create_user(UserName="reader")
may = {"Effect": "Allow", "Action": "s3:GetObject", "Resource": "*"}
policy = json.dumps({"Version": "2012-10-17", "Statement": [may]})
iam.put_user_policy(UserName="reader", PolicyName="read", PolicyDocument=policy)
key = iam.create_access_key(UserName="reader")["AccessKey"]
print(key["AccessKeyId"], key["SecretAccessKey"])
"#;
/// Puts that file in place of the public one. From then on everybody is asked who he is.
const GO_ON: &str = r#"
put("public.df", ACL="public-read")
urllib.request.urlopen(urllib.request.Request(
    sys.argv[1] + "/moto-api/reset-auth", data=b"0", method="POST", headers={"Content-Type": "text/plain"}))
"#;

#[test]
fn a_bucket_of_moto_is_read_by_whoever_may() {
    let Some(server) = moto() else { return };
    let (folder, endpoint) = (tempfile::tempdir().unwrap(), server.url("").trim_end_matches('/').to_owned());
    let told_by = |script: &str, bytes: &[u8]| {
        let path = folder.path().join("put.df");
        std::fs::write(&path, bytes).unwrap();
        let mut command = Command::new(python());
        command.arg("-c").arg(format!("{CLIENT}{script}")).arg(&endpoint).arg(path).env("NO_PROXY", "*");
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let keys = told_by(SET_UP, sound());
    let (id, secret) = keys.trim().split_once(' ').unwrap();
    // What is said of all pages, in one line where they cannot be read.
    let verified = |name: &str, variables: &[(&str, &str)]| {
        let mut verify = program();
        verify.args(["verify", &format!("s3://data/{name}")]).env("XDG_CACHE_HOME", folder.path());
        without_keys(&mut verify).env("AWS_ENDPOINT_URL", &endpoint).envs(variables.iter().copied());
        let output = verify.output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        match output.status.success() {
            true => Ok(()),
            false => {
                assert!(told.lines().count() == 1 && told.contains(name) && !told.contains(secret), "{told}");
                Err(told)
            }
        }
    };
    let public = [("AWS_SKIP_SIGNATURE", "true")];
    let signed = |secret| [("AWS_ACCESS_KEY_ID", id), ("AWS_SECRET_ACCESS_KEY", secret)];
    assert_eq!(verified("public.df", &public), Ok(()));
    let refused = "bucket data does not let this be read (status 403)";
    assert!(verified("private.df", &public).unwrap_err().contains(refused));
    let told = verified("absent.df", &signed(secret)).unwrap_err();
    assert!(told.contains("bucket data has no such file (status 404)"), "{told}");
    told_by(GO_ON, &vec![0_u8; sound().len()]);
    // What was kept of another version is not shown.
    assert!(verified("public.df", &signed(secret)).is_err());
    assert_eq!(verified("private.df", &signed(secret)), Ok(()));
    assert!(verified("private.df", &signed("wrong")).unwrap_err().contains(refused));
}
