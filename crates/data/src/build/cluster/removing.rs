//! Removing a job: what there is of it, and what tasks that run meanwhile write after that.

use super::{Job, Plan, Stage, is_begun_plan, job_error, run, settings, stages};
use crate::build::BuildError;
use crate::store::StoreError;
use crate::store::temporary::MARK;
use std::ffi::OsStr;
use std::io::ErrorKind;
use std::path::Path;

/// The script in a job's folder that gives its tasks to a scheduler, and the folder of what they say there.
const SCRIPT: &str = "submit.sh";
const LOGS: &str = "logs";

/// What a task says whose job is gone.
const REMOVED: &str = "found no job any more, or another one, expected that of this task: it was removed (`deepfield build --cancel`) \
                       while the task ran";

impl Job {
    /// Removes what the job has written, but for the page file once it has its name, and the job's folder where nothing else is in it. Tasks that
    /// still run remove what they write after that, and fail.
    ///
    /// # Errors
    /// When something cannot be removed.
    pub fn remove(self) -> Result<(), BuildError> {
        self.remove_results()?;
        if let Plan::Run(own) = &self.plan {
            own.remove_left(&self.folder);
        }
        remove(&self.folder.join(SCRIPT))?;
        let logs = self.folder.join(LOGS);
        for entry in std::fs::read_dir(&logs).into_iter().flatten().flatten() {
            if entry.file_name().to_str().is_some_and(|name| self.is_log(name)) {
                remove(&entry.path())?;
            }
        }
        // Whatever others keep there stays.
        let _ = std::fs::remove_dir(&logs);
        // Last, so that what was not removed can be tried again.
        remove(&self.folder.join(settings::FILE))?;
        // But for what tasks have written meanwhile, which have found the plan, or are killed before they look for it.
        self.remove_results()?;
        let _ = std::fs::remove_dir(&self.folder);
        Ok(())
    }

    /// Removes what tasks have written.
    fn remove_results(&self) -> Result<(), BuildError> {
        let io = |source| StoreError::Io { path: self.folder.clone(), action: "read", source };
        let entries = match std::fs::read_dir(&self.folder) {
            // With the last of its tasks.
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            entries => Some(entries.map_err(io)?),
        };
        for entry in entries.into_iter().flatten() {
            let entry = entry.map_err(io)?;
            if self.is_ours(&entry.file_name()) {
                remove(&entry.path())?;
            }
        }
        remove(&self.growing())
    }

    /// Looks whether the job of task `number`, which runs, is still there. If not, the task's result goes: nobody else knows of it. The file that was
    /// to be the output stays: the folder may have been moved, and the job with it.
    ///
    /// # Errors
    /// Where the job was removed.
    pub(super) fn check_is_there(&self, number: u32) -> Result<(), BuildError> {
        let is_other = match settings::read(&self.folder) {
            Ok((id, _)) if id != self.id => true,
            Err(BuildError::Store(StoreError::Io { source, .. })) if source.kind() == ErrorKind::NotFound => false,
            // A plan that is damaged, or cannot be read now, is there.
            _ => return Ok(()),
        };
        // What cannot be removed stays: that is not what went wrong. Files of another job's tasks, or of whoever has the folder now, may have the
        // same names.
        let names = self.names();
        if names.is_own(number) {
            let _ = remove(&names.path(number));
            // Its page file does not tell whose it is.
            if !is_other && matches!(self.plan, Plan::Run(_)) {
                let _ = remove(&run::still_path(&self.folder, number));
            }
        }
        if !is_other {
            let _ = std::fs::remove_dir(&self.folder);
        }
        Err(job_error(&self.folder, REMOVED))
    }

    /// Whether what tasks say goes to a file of this name.
    fn is_log(&self, name: &str) -> bool {
        let is_stage = |stage: &Stage| name.strip_prefix(&stage.name).is_some_and(|rest| rest.starts_with('-'));
        name.ends_with(".log") && self.stages.iter().any(is_stage)
    }

    /// Whether a task's file has this name, or one that it has until it is complete.
    fn is_ours(&self, name: &OsStr) -> bool {
        if is_begun_plan(name) {
            return true;
        }
        let Some(name) = name.to_str() else { return false };
        let is_temporary = |text: &str| text.starts_with(&MARK[1..]);
        let Some((stage, rest)) = name.split_once('.') else { return false };
        let is_stage = self.stages.iter().any(|own| own.name == stage) || [stages::SPILL, run::STILL].contains(&stage);
        let (task, temporary) = rest.split_once('.').map_or((rest, None), |(task, rest)| (task, Some(rest)));
        is_stage && task.parse::<u32>().is_ok() && temporary.is_none_or(is_temporary)
    }
}

/// Removes a file, if it is there.
fn remove(path: &Path) -> Result<(), BuildError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            Err(StoreError::Io { path: path.to_owned(), action: "remove", source }.into())
        }
        _ => Ok(()),
    }
}
