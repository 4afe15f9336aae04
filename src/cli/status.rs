//! Arguments of `calib status`.

use std::{
    net::{AddrParseError, IpAddr, Ipv4Addr, SocketAddr},
    path::PathBuf,
    str::FromStr,
};

use calib_pipeline::StatusRequest;
use clap::Args;

use super::heading::OUTPUT;

#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// A study file, the folder of its results, or a plan of `calib cluster plan`
    #[arg(value_name = "STUDY|DIR")]
    pub(crate) path: PathBuf,
    /// Override a key of the study, as it was when it was run; may be given several times
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// The study as this one of its [profiles] has it
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Where results go (default: beside the study file)
    #[arg(long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// Say it again every two seconds, until nothing runs any more or Ctrl-C is pressed
    #[arg(long, conflicts_with_all = ["json", "serve"])]
    pub(crate) watch: bool,
    /// Show it as a page that refreshes itself, at this address of this machine, such as 127.0.0.1:8080 or 8080, until Ctrl-C is pressed
    #[arg(long, value_name = "ADDRESS", conflicts_with = "json")]
    pub(crate) serve: Option<Address>,
    /// Print it as JSON
    #[arg(long, help_heading = OUTPUT)]
    pub(crate) json: bool,
}

impl From<StatusArgs> for StatusRequest {
    fn from(args: StatusArgs) -> Self {
        let StatusArgs { path, set, profile, output, .. } = args;
        Self { path, set, profile, output }
    }
}

/// Address of a page: an IP address with a port, or only a port, which then serves this machine alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Address(pub(crate) SocketAddr);

impl FromStr for Address {
    type Err = AddrParseError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Ok(port) = text.parse() {
            return Ok(Self(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port)));
        }
        text.replace("localhost:", "127.0.0.1:").parse().map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<String, AddrParseError> {
        text.parse::<Address>().map(|address| address.0.to_string())
    }

    #[test]
    fn a_port_alone_is_one_of_this_machine() {
        assert_eq!(read("8080").as_deref(), Ok("127.0.0.1:8080"));
        assert_eq!(read("localhost:80").as_deref(), Ok("127.0.0.1:80"));
        assert_eq!(read("[::1]:80").as_deref(), Ok("[::1]:80"));
        assert_eq!(read("0.0.0.0:80").as_deref(), Ok("0.0.0.0:80"));
        assert!(read("here").is_err() && read("99999").is_err());
    }
}
