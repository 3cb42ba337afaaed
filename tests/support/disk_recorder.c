/* LD_PRELOAD: logs what a process does to the files under $DISK_ROOT into $DISK_LOG, and refuses it where it is told to.

   A record: operation, inode, offset, length of path and of data (int64 each), then path and data. The file $DISK_TOLD,
   while it is there, says what is refused, and where: "write session.db" or "fsync session.db" with EIO, "shm session.db":
   no shared memory for SQLite. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { OPEN, WRITE, TRUNCATE, SYNC, RENAME, LINK, UNLINK, MKDIR };

static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;
static int log_file = -1;

static int inside(const char *path) {
    const char *root = getenv("DISK_ROOT");
    return root && path && !strncmp(path, root, strlen(root));
}

static int path_of(int fd, char *path) {
    char name[64];
    snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(name, path, 4000);
    path[n < 0 ? 0 : n] = 0;
    return n > 0 && inside(path);
}

static int refused(const char *what, const char *path) {
    char said[256] = "";
    const char *told = getenv("DISK_TOLD");
    int file = told ? syscall(SYS_openat, AT_FDCWD, told, O_RDONLY) : -1;
    if (file < 0) return 0;
    ssize_t n = syscall(SYS_read, file, said, sizeof said - 1);
    syscall(SYS_close, file);
    const char *where = strchr(said, ' ');
    return n > 0 && where && !strncmp(said, what, strlen(what)) && strstr(path, where + 1);
}

static void note(int64_t what, int64_t inode, int64_t offset, const char *path, const void *data, int64_t length) {
    if (log_file < 0)
        log_file = syscall(SYS_openat, AT_FDCWD, getenv("DISK_LOG"), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    int64_t head[5] = {what, inode, offset, (int64_t)strlen(path), length};
    syscall(SYS_write, log_file, head, sizeof head);
    syscall(SYS_write, log_file, path, strlen(path));
    if (length) syscall(SYS_write, log_file, data, length);
}

#define REAL(name, type, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = dlsym(RTLD_NEXT, name)
#define LOGGED(done, call) \
    do { int kept; pthread_mutex_lock(&turn); done; kept = errno; call; pthread_mutex_unlock(&turn); errno = kept; } while (0)

static int opened(int fd, const char *path, int flags) {
    struct stat about;
    char whole[4096];
    if (fd >= 0 && path_of(fd, whole) && !fstat(fd, &about) && S_ISREG(about.st_mode) && (flags & (O_CREAT | O_TRUNC)))
        note(OPEN, about.st_ino, (flags & O_TRUNC) != 0, whole, 0, 0);
    return fd;
}

#define OPENS(name) \
    int name(const char *path, int flags, ...) { \
        REAL(#name, int, const char *, int, ...); \
        va_list more; va_start(more, flags); mode_t mode = va_arg(more, int); va_end(more); \
        size_t n = strlen(path); \
        if (n > 4 && !strcmp(path + n - 4, "-shm") && refused("shm", path)) { errno = EACCES; return -1; } \
        int fd; \
        LOGGED(fd = real(path, flags, mode), opened(fd, path, flags)); \
        return fd; \
    }
#define OPENS_AT(name) \
    int name(int at, const char *path, int flags, ...) { \
        REAL(#name, int, int, const char *, int, ...); \
        va_list more; va_start(more, flags); mode_t mode = va_arg(more, int); va_end(more); \
        int fd; \
        LOGGED(fd = real(at, path, flags, mode), opened(fd, path, flags)); \
        return fd; \
    }
OPENS(open)
OPENS(open64)
OPENS_AT(openat)
OPENS_AT(openat64)

static void wrote(int fd, const char *path, const void *data, ssize_t n, off_t offset) {
    struct stat about;
    if (n > 0 && !fstat(fd, &about) && S_ISREG(about.st_mode)) note(WRITE, about.st_ino, offset, path, data, n);
}

#define REFUSE(path, what) if (refused(what, path)) { errno = EIO; return -1; }

ssize_t write(int fd, const void *data, size_t n) {
    REAL("write", ssize_t, int, const void *, size_t);
    char path[4096];
    if (!path_of(fd, path)) return real(fd, data, n);
    REFUSE(path, "write")
    ssize_t done;
    LOGGED(done = real(fd, data, n), wrote(fd, path, data, done, lseek(fd, 0, SEEK_CUR) - done));
    return done;
}

#define PWRITES(name) \
    ssize_t name(int fd, const void *data, size_t n, off_t offset) { \
        REAL(#name, ssize_t, int, const void *, size_t, off_t); \
        char path[4096]; \
        if (!path_of(fd, path)) return real(fd, data, n, offset); \
        REFUSE(path, "write") \
        ssize_t done; \
        LOGGED(done = real(fd, data, n, offset), wrote(fd, path, data, done, offset)); \
        return done; \
    }
PWRITES(pwrite)
PWRITES(pwrite64)

#define TRUNCATES(name) \
    int name(int fd, off_t length) { \
        REAL(#name, int, int, off_t); \
        char path[4096]; \
        if (!path_of(fd, path)) return real(fd, length); \
        struct stat about; \
        int done; \
        LOGGED(done = real(fd, length), if (!done && !fstat(fd, &about)) note(TRUNCATE, about.st_ino, length, path, 0, 0)); \
        return done; \
    }
TRUNCATES(ftruncate)
TRUNCATES(ftruncate64)

#define SYNCS(name) \
    int name(int fd) { \
        REAL(#name, int, int); \
        char path[4096]; \
        if (!path_of(fd, path)) return real(fd); \
        REFUSE(path, "fsync") \
        struct stat about; \
        pthread_mutex_lock(&turn); \
        if (!fstat(fd, &about)) note(SYNC, about.st_ino, S_ISDIR(about.st_mode), path, 0, 0); \
        pthread_mutex_unlock(&turn); \
        return 0; /* the real disk need not */ \
    }
SYNCS(fsync)
SYNCS(fdatasync)

int rename(const char *from, const char *to) {
    REAL("rename", int, const char *, const char *);
    int done;
    LOGGED(done = real(from, to), if (!done && inside(to)) note(RENAME, 0, 0, from, to, strlen(to)));
    return done;
}

int link(const char *from, const char *to) {
    REAL("link", int, const char *, const char *);
    int done;
    LOGGED(done = real(from, to), if (!done && inside(to)) note(LINK, 0, 0, from, to, strlen(to)));
    return done;
}

int linkat(int a, const char *from, int b, const char *to, int flags) {
    REAL("linkat", int, int, const char *, int, const char *, int);
    int done;
    LOGGED(done = real(a, from, b, to, flags), if (!done && inside(to)) note(LINK, 0, 0, from, to, strlen(to)));
    return done;
}

int unlink(const char *path) {
    REAL("unlink", int, const char *);
    int done;
    LOGGED(done = real(path), if (!done && inside(path)) note(UNLINK, 0, 0, path, 0, 0));
    return done;
}

int rmdir(const char *path) {
    REAL("rmdir", int, const char *);
    int done;
    LOGGED(done = real(path), if (!done && inside(path)) note(UNLINK, 0, 0, path, 0, 0));
    return done;
}

int mkdir(const char *path, mode_t mode) {
    REAL("mkdir", int, const char *, mode_t);
    int done;
    LOGGED(done = real(path, mode), if (!done && inside(path)) note(MKDIR, 0, 0, path, 0, 0));
    return done;
}
