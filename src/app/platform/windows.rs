//! Windows.

use std::io::IsTerminal;
use std::os::windows::io::AsRawHandle;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use windows_sys::Win32::Foundation::{FILETIME, HWND, LPARAM, LRESULT, WPARAM};
use windows_sys::Win32::Media::timeBeginPeriod;
use windows_sys::Win32::Storage::FileSystem::{BY_HANDLE_FILE_INFORMATION, GetFileInformationByHandle};
use windows_sys::Win32::System::Console::{
    AllocConsole, CTRL_BREAK_EVENT, CTRL_C_EVENT, FreeConsole, GetConsoleProcessList, GetStdHandle, STD_ERROR_HANDLE,
    STD_INPUT_HANDLE, STD_OUTPUT_HANDLE, SetConsoleCtrlHandler, SetStdHandle,
};
use windows_sys::Win32::System::JobObjects::{
    AssignProcessToJobObject, CreateJobObjectW, JOB_OBJECT_LIMIT_PROCESS_MEMORY, JOBOBJECT_EXTENDED_LIMIT_INFORMATION,
    JobObjectExtendedLimitInformation, SetInformationJobObject,
};
use windows_sys::Win32::System::LibraryLoader::GetModuleHandleW;
use windows_sys::Win32::System::Threading::{
    GetCurrentProcess, GetCurrentThread, GetThreadTimes, PROCESS_POWER_THROTTLING_CURRENT_VERSION,
    PROCESS_POWER_THROTTLING_EXECUTION_SPEED, PROCESS_POWER_THROTTLING_IGNORE_TIMER_RESOLUTION,
    PROCESS_POWER_THROTTLING_STATE, ProcessPowerThrottling, SetProcessInformation, SetThreadPriority,
    THREAD_PRIORITY_ABOVE_NORMAL, THREAD_PRIORITY_BELOW_NORMAL, THREAD_PRIORITY_LOWEST, TerminateProcess,
};
use windows_sys::Win32::UI::WindowsAndMessaging::{
    CreateWindowExW, DefWindowProcW, DispatchMessageW, GetMessageW, MSG, RegisterClassW, WM_CLOSE, WM_ENDSESSION,
    WM_QUERYENDSESSION, WNDCLASSW,
};
use windows_sys::core::{BOOL, w};

/// Steps of `nice` from which a thread gets the lowest priority. Choice: those of the reconstruction by default.
const LOWEST_FROM: u8 = 5;

/// The flag of [`stop_when_asked`]: the system calls back without an argument.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Sets the flag at Ctrl-C, Ctrl-Break, when the console's window closes, when the user logs off, and at shutdown; a second
/// Ctrl-C ends the program at once.
///
/// A process that has loaded user32.dll gets the events of logging off and shutdown as messages to a window and not from the
/// console (Microsoft, "HandlerRoutine callback function", remarks), and one without a console only so.
pub fn stop_when_asked(stop: &Arc<AtomicBool>) -> std::io::Result<()> {
    if STOP.set(Arc::clone(stop)).is_err() {
        return Err(std::io::Error::other("the events that end the program are already handled"));
    }
    // SAFETY: the handler is a function of this program, which is never unloaded.
    if unsafe { SetConsoleCtrlHandler(Some(on_console_event), 1) } == 0 {
        log::warn!("Ctrl-C cannot be handled: {}", std::io::Error::last_os_error());
    }
    std::thread::Builder::new().name("session end".into()).spawn(receive_session_end).map(drop)
}

/// Sets the flag; returns whether it was set before.
fn ask_to_stop() -> bool {
    STOP.get().is_some_and(|stop| stop.swap(true, Ordering::SeqCst))
}

/// The system ends the process as soon as a handler of these events returns, and some 5 s after it has called it in any case:
/// until then the main thread closes recordings, and its return ends the process and this thread.
fn wait_for_end() -> ! {
    loop {
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// Runs on a thread that the system makes.
unsafe extern "system" fn on_console_event(kind: u32) -> BOOL {
    let was_asked = ask_to_stop();
    match kind {
        // Not handled: the system's own handler ends the process.
        CTRL_C_EVENT | CTRL_BREAK_EVENT => BOOL::from(!was_asked),
        _ => wait_for_end(),
    }
}

/// Receives the end of the user's session by a window that is never shown.
fn receive_session_end() {
    // SAFETY: a class without extras, whose procedure and name are constants of this program; all pointers that may be null
    // are. The messages are those of this thread's window.
    unsafe {
        let name = w!("radar-chaperone session end");
        let instance = GetModuleHandleW(null());
        let class =
            WNDCLASSW { lpfnWndProc: Some(on_message), hInstance: instance, lpszClassName: name, ..std::mem::zeroed() };
        RegisterClassW(&class);
        // Not a message-only window: those do not receive these messages.
        if CreateWindowExW(0, name, name, 0, 0, 0, 0, 0, null_mut(), null_mut(), instance, null()).is_null() {
            log::info!("logging off will not be noticed: {}", std::io::Error::last_os_error());
            return;
        }
        let mut message = std::mem::zeroed::<MSG>();
        while GetMessageW(&mut message, null_mut(), 0, 0) > 0 {
            DispatchMessageW(&message);
        }
    }
}

unsafe extern "system" fn on_message(window: HWND, message: u32, wide: WPARAM, long: LPARAM) -> LRESULT {
    match message {
        WM_QUERYENDSESSION => 1,
        WM_ENDSESSION if wide != 0 => {
            ask_to_stop();
            wait_for_end()
        }
        // How `taskkill` asks.
        WM_CLOSE => {
            ask_to_stop();
            0
        }
        // SAFETY: the arguments are those that the system gave.
        _ => unsafe { DefWindowProcW(window, message, wide, long) },
    }
}

/// Ends the process at once: at an orderly exit a hanging library would wait for its own threads.
pub fn exit_now(code: i32) -> ! {
    // SAFETY: the pseudo-handle of this process, which is always valid.
    unsafe { TerminateProcess(GetCurrentProcess(), code as u32) };
    std::process::exit(code)
}

/// From now on the process gets no more memory than this; an allocation beyond it ends the process.
///
/// # Errors
/// The system refuses.
pub fn limit_memory_of_this_process(bytes: u64) -> std::io::Result<()> {
    let refused = |done: BOOL| if done == 0 { Err(std::io::Error::last_os_error()) } else { Ok(()) };
    let mut limits = JOBOBJECT_EXTENDED_LIMIT_INFORMATION {
        ProcessMemoryLimit: usize::try_from(bytes).unwrap_or(usize::MAX),
        ..Default::default()
    };
    limits.BasicLimitInformation.LimitFlags = JOB_OBJECT_LIMIT_PROCESS_MEMORY;
    // SAFETY: a job without name and with the usual rights; a structure of the kind that is named, with its size; the process' own
    // handle. The job lasts as long as the process in it.
    unsafe {
        let job = CreateJobObjectW(null(), null());
        if job.is_null() {
            return Err(std::io::Error::last_os_error());
        }
        let length = size_of_val(&limits) as u32;
        refused(SetInformationJobObject(job, JobObjectExtendedLimitInformation, (&raw const limits).cast(), length))?;
        refused(AssignProcessToJobObject(job, GetCurrentProcess()))
    }
}

/// Volume and index: equal for two open files only if they are the same file, whatever their names.
///
/// # Errors
/// The system refuses.
pub fn file_identity(file: &std::fs::File) -> std::io::Result<[u64; 2]> {
    let mut found = BY_HANDLE_FILE_INFORMATION::default();
    // SAFETY: the handle is open while `file` is borrowed, and the call writes at most the structure.
    if unsafe { GetFileInformationByHandle(file.as_raw_handle(), &mut found) } == 0 {
        return Err(std::io::Error::last_os_error());
    }
    let index = u64::from(found.nFileIndexHigh) << 32 | u64::from(found.nFileIndexLow);
    Ok([u64::from(found.dwVolumeSerialNumber), index])
}

/// Processor time of the calling thread, nanoseconds. The system counts it at its clock's interrupts, so short pieces of work
/// are 0 or some milliseconds; the sum is right.
pub fn thread_cpu_ns() -> i64 {
    let zero = FILETIME { dwLowDateTime: 0, dwHighDateTime: 0 };
    let (mut created, mut ended, mut kernel, mut user) = (zero, zero, zero, zero);
    // SAFETY: the handle stands for the calling thread; four variables for its times.
    if unsafe { GetThreadTimes(GetCurrentThread(), &mut created, &mut ended, &mut kernel, &mut user) } == 0 {
        return 0;
    }
    let hundred_ns = |time: FILETIME| i64::from(time.dwHighDateTime) << 32 | i64::from(time.dwLowDateTime);
    (hundred_ns(kernel) + hundred_ns(user)) * 100
}

fn set_priority(priority: i32) {
    // SAFETY: the handle stands for the calling thread.
    unsafe { SetThreadPriority(GetCurrentThread(), priority) };
}

/// Lowers the calling thread; the steps are those of Linux' `nice`. A thread that may run takes the core from a lower one,
/// which Windows lets run for a moment every few seconds all the same.
pub fn lower_priority_of_this_thread(by: u8) {
    match by {
        0 => {}
        by if by < LOWEST_FROM => set_priority(THREAD_PRIORITY_BELOW_NORMAL),
        _ => set_priority(THREAD_PRIORITY_LOWEST),
    }
}

/// Raises the calling thread above others of the same class: for the frame loop and the sensor's reader, which work for a
/// moment and wait.
pub fn raise_priority_of_this_thread() {
    set_priority(THREAD_PRIORITY_ABOVE_NORMAL);
}

/// Asks for timers of 1 ms instead of 15.6 ms, and for full speed although no window is in front. Until the program ends.
pub fn refine_timers() {
    let state = PROCESS_POWER_THROTTLING_STATE {
        Version: PROCESS_POWER_THROTTLING_CURRENT_VERSION,
        ControlMask: PROCESS_POWER_THROTTLING_EXECUTION_SPEED | PROCESS_POWER_THROTTLING_IGNORE_TIMER_RESOLUTION,
        StateMask: 0,
    };
    // SAFETY: a constant and a structure of the size that is given; systems that do not know it refuse it.
    unsafe {
        timeBeginPeriod(1);
        let length = size_of_val(&state) as u32;
        SetProcessInformation(GetCurrentProcess(), ProcessPowerThrottling, (&raw const state).cast(), length);
    }
}

/// Opens a console for a command that prints when there is neither one nor a file to print to: our manifest tells Windows to
/// make none, so that SteamVR's start of `run` opens no window.
pub fn open_missing_console() {
    let mut processes = [0; 2];
    // SAFETY: room for as many numbers as is said; the rest takes no pointers.
    unsafe {
        let has_console = GetConsoleProcessList(processes.as_mut_ptr(), processes.len() as u32) != 0;
        if !has_console && GetStdHandle(STD_OUTPUT_HANDLE).is_null() {
            AllocConsole();
        }
    }
}

/// Whether a console was made for this process alone: its window closes with the process.
pub fn has_own_console() -> bool {
    let mut processes = [0; 2];
    // SAFETY: room for as many numbers as is said.
    unsafe { GetConsoleProcessList(processes.as_mut_ptr(), processes.len() as u32) == 1 }
}

/// Leaves a console that was made for this process alone, as when SteamVR starts it: its window closes. What is printed from
/// then on goes nowhere.
pub fn leave_own_console() {
    if !has_own_console() {
        return;
    }
    let streams = [
        (STD_INPUT_HANDLE, std::io::stdin().is_terminal()),
        (STD_OUTPUT_HANDLE, std::io::stdout().is_terminal()),
        (STD_ERROR_HANDLE, std::io::stderr().is_terminal()),
    ];
    // SAFETY: nobody holds the console's handles but the standard streams, which look them up at each use. Null stands for
    // "none"; the numbers of the old ones may soon be those of files.
    unsafe {
        for (stream, _) in streams.into_iter().filter(|(_, is_console)| *is_console) {
            SetStdHandle(stream, null_mut());
        }
        FreeConsole();
    }
}
