/* Faults of disks and network folders, below one folder: LD_PRELOAD this into a process.
 *
 * FAULTS_BELOW   the folder, absolute; paths elsewhere are left alone
 * FAULTS_KINDS   letters: s short reads and writes, i EINTR, e EIO, t ESTALE
 * FAULTS_SEED    a number; the same calls of a process meet the same faults
 * FAULTS_RATE    one call in so many meets one
 * FAULTS_LOG     a file elsewhere, to which each fault is appended: its kind, the call, and the path
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <unistd.h>

#define REAL(result, name, ...) \
    static result (*real)(__VA_ARGS__); \
    if (!real) *(void **)&real = dlsym(RTLD_NEXT, name)

static _Atomic uint64_t calls;

/* A number of this call, well mixed: splitmix64 of the seed and how many calls there were. */
static uint64_t chance(void) {
    const char *seed = getenv("FAULTS_SEED");
    uint64_t x = (seed ? strtoull(seed, 0, 10) : 0) * 0x9E3779B97F4A7C15u + ++calls * 0xD1B54A32D192ED03u;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
    return x ^ (x >> 31);
}

static int is_below(const char *path) {
    const char *below = getenv("FAULTS_BELOW");
    size_t length = below ? strlen(below) : 0;
    return length && !strncmp(path, below, length) && path[length] == '/';
}

/* The absolute path of one that may be relative to a folder's descriptor; not of links within it. */
static void absolute(int folder, const char *path, char *full) {
    char link[64];
    ssize_t length = 0;
    if (path[0] != '/') {
        if (folder == AT_FDCWD) strcpy(link, "/proc/self/cwd");
        else snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
        length = syscall(SYS_readlink, link, full, PATH_MAX - 1);
        if (length < 0) length = 0;
        full[length++] = '/';
    }
    snprintf(full + length, PATH_MAX - length, "%s", path);
}

/* Which of the allowed kinds this call meets, 0 for none; it is noted in the log. */
static char fault(const char *call, const char *allowed, int folder, const char *path) {
    const char *kinds = getenv("FAULTS_KINDS"), *rate = getenv("FAULTS_RATE"), *log = getenv("FAULTS_LOG");
    if (!kinds || !rate || !log) return 0;
    uint64_t number = chance();
    if (number % strtoull(rate, 0, 10)) return 0;
    char kind = kinds[(number >> 40) % strlen(kinds)], full[2 * PATH_MAX], line[2 * PATH_MAX + 64];
    if (!strchr(allowed, kind)) return 0;
    int before = errno;
    absolute(folder, path, full);
    if (!is_below(full)) { errno = before; return 0; }
    int length = snprintf(line, sizeof line, "%c %s %s\n", kind, call, full);
    int file = syscall(SYS_openat, AT_FDCWD, log, O_WRONLY | O_APPEND | O_CREAT, 0644);
    if (file >= 0) { syscall(SYS_write, file, line, length); syscall(SYS_close, file); }
    errno = before;
    return kind;
}

static char fault_of_file(const char *call, const char *allowed, int file) {
    char link[64], path[PATH_MAX];
    const char *rate = getenv("FAULTS_RATE");
    if (!rate || file < 0) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    int before = errno;
    ssize_t length = syscall(SYS_readlink, link, path, PATH_MAX - 1);
    errno = before;
    if (length <= 0 || path[0] != '/') return 0;
    path[length] = 0;
    return is_below(path) ? fault(call, allowed, AT_FDCWD, path) : 0;
}

static int failed(char kind) {
    errno = kind == 'i' ? EINTR : kind == 't' ? ESTALE : EIO;
    return -1;
}

/* Opening */

static mode_t mode_in(int flags, va_list rest) {
    return flags & (O_CREAT | __O_TMPFILE) ? va_arg(rest, mode_t) : 0;
}

#define OPEN(name) \
    int name(const char *path, int flags, ...) { \
        REAL(int, #name, const char *, int, ...); \
        va_list rest; va_start(rest, flags); mode_t mode = mode_in(flags, rest); va_end(rest); \
        char kind = fault("open", "iet", AT_FDCWD, path); \
        return kind ? failed(kind) : real(path, flags, mode); \
    }
OPEN(open)
OPEN(open64)

#define OPENAT(name) \
    int name(int folder, const char *path, int flags, ...) { \
        REAL(int, #name, int, const char *, int, ...); \
        va_list rest; va_start(rest, flags); mode_t mode = mode_in(flags, rest); va_end(rest); \
        char kind = fault("open", "iet", folder, path); \
        return kind ? failed(kind) : real(folder, path, flags, mode); \
    }
OPENAT(openat)
OPENAT(openat64)

#define FOPEN(name) \
    FILE *name(const char *path, const char *mode) { \
        REAL(FILE *, #name, const char *, const char *); \
        char kind = fault("fopen", "et", AT_FDCWD, path); \
        if (kind) { failed(kind); return NULL; } \
        return real(path, mode); \
    }
FOPEN(fopen)
FOPEN(fopen64)

/* Reading and writing */

#define SHORTENED(kind, size) ((kind) == 's' && (size) > 1 ? 1 + (size) / 3 : (size))

ssize_t read(int file, void *data, size_t size) {
    REAL(ssize_t, "read", int, void *, size_t);
    char kind = fault_of_file("read", "siet", file);
    return kind && kind != 's' ? failed(kind) : real(file, data, SHORTENED(kind, size));
}

ssize_t write(int file, const void *data, size_t size) {
    REAL(ssize_t, "write", int, const void *, size_t);
    char kind = fault_of_file("write", "siet", file);
    return kind && kind != 's' ? failed(kind) : real(file, data, SHORTENED(kind, size));
}

#define PREAD(name, type, word, data_type) \
    ssize_t name(int file, data_type data, size_t size, type place) { \
        REAL(ssize_t, #name, int, data_type, size_t, type); \
        char kind = fault_of_file(word, "siet", file); \
        return kind && kind != 's' ? failed(kind) : real(file, data, SHORTENED(kind, size), place); \
    }
PREAD(pread, off_t, "read", void *)
PREAD(pread64, off64_t, "read", void *)
PREAD(pwrite, off_t, "write", const void *)
PREAD(pwrite64, off64_t, "write", const void *)

size_t fwrite(const void *data, size_t size, size_t count, FILE *file) {
    REAL(size_t, "fwrite", const void *, size_t, size_t, FILE *);
    char kind = fault_of_file("fwrite", "et", fileno(file));
    if (kind) { failed(kind); return 0; }
    return real(data, size, count, file);
}

#define FILE_CALL(name, allowed) \
    int name(int file) { \
        REAL(int, #name, int); \
        char kind = fault_of_file(#name, allowed, file); \
        return kind ? failed(kind) : real(file); \
    }
FILE_CALL(fsync, "iet")
FILE_CALL(fdatasync, "iet")

int close(int file) { /* closes it in any case, as Linux does */
    REAL(int, "close", int);
    char kind = fault_of_file("close", "et", file);
    int result = real(file);
    return kind ? failed(kind) : result;
}

/* Names */

#define PATH_CALL(name, word, allowed, arguments, values, path) \
    int name arguments { \
        REAL(int, #name, ARGS arguments); \
        char kind = fault(word, allowed, AT_FDCWD, path); \
        return kind ? failed(kind) : real values; \
    }
#define ARGS(...) __VA_ARGS__
PATH_CALL(rename, "rename", "et", (const char *one, const char *other), (one, other), other)
PATH_CALL(link, "link", "et", (const char *one, const char *other), (one, other), other)
PATH_CALL(unlink, "unlink", "et", (const char *path), (path), path)
PATH_CALL(mkdir, "mkdir", "et", (const char *path, mode_t mode), (path, mode), path)
PATH_CALL(stat, "stat", "et", (const char *path, struct stat *facts), (path, facts), path)
PATH_CALL(lstat, "stat", "et", (const char *path, struct stat *facts), (path, facts), path)
PATH_CALL(stat64, "stat", "et", (const char *path, struct stat64 *facts), (path, facts), path)
PATH_CALL(lstat64, "stat", "et", (const char *path, struct stat64 *facts), (path, facts), path)

#define FOLDER_CALL(name, word, allowed, arguments, values, folder, path) \
    int name arguments { \
        REAL(int, #name, ARGS arguments); \
        char kind = fault(word, allowed, folder, path); \
        return kind ? failed(kind) : real values; \
    }
FOLDER_CALL(fstatat, "stat", "et", (int at, const char *path, struct stat *facts, int flags), (at, path, facts, flags), at, path)
FOLDER_CALL(fstatat64, "stat", "et", (int at, const char *path, struct stat64 *facts, int flags), (at, path, facts, flags), at, path)
FOLDER_CALL(renameat, "rename", "et", (int from, const char *one, int to, const char *other), (from, one, to, other), to, other)
FOLDER_CALL(renameat2, "rename", "et", (int from, const char *one, int to, const char *other, unsigned flags), (from, one, to, other, flags), to, other)
FOLDER_CALL(linkat, "link", "et", (int from, const char *one, int to, const char *other, int flags), (from, one, to, other, flags), to, other)
FOLDER_CALL(unlinkat, "unlink", "et", (int at, const char *path, int flags), (at, path, flags), at, path)
