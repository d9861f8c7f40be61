/* Loaded before the C library: after each fsync or fdatasync of a file in POWER_CUT_FOLDER (or of the folder itself)
 * every file in it is copied to POWER_CUT_OUT/NNNNNN, with the synced one's name in POWER_CUT_OUT/NNNNNN.synced.
 * That is all that a disk can be held to when power goes at that instant. */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static unsigned count;

static void copy(const char *from, const char *to)
{
    char buffer[65536];
    ssize_t size;
    int in = open(from, O_RDONLY), out = open(to, O_WRONLY | O_CREAT | O_TRUNC, 0644);

    while (in >= 0 && out >= 0 && (size = read(in, buffer, sizeof buffer)) > 0)
        if (write(out, buffer, size) != size)
            abort();
    close(in);
    close(out);
}

static void keep(int handle)
{
    const char *folder = getenv("POWER_CUT_FOLDER"), *out = getenv("POWER_CUT_OUT");
    char link[64], path[PATH_MAX], from[PATH_MAX + 260], to[PATH_MAX + 260];
    struct dirent *entry;
    ssize_t size;
    DIR *listing;
    FILE *note;

    if (!folder || !out)
        return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    size = readlink(link, path, sizeof path - 1);
    if (size < 0)
        return;
    path[size] = 0;
    if (strncmp(path, folder, strlen(folder)) || (path[strlen(folder)] && strchr(path + strlen(folder) + 1, '/')))
        return;
    snprintf(to, sizeof to, "%s/%06u", out, ++count);
    mkdir(to, 0755);
    listing = opendir(folder);
    while (listing && (entry = readdir(listing))) {
        if (entry->d_type != DT_REG)
            continue;
        snprintf(from, sizeof from, "%s/%s", folder, entry->d_name);
        snprintf(to, sizeof to, "%s/%06u/%s", out, count, entry->d_name);
        copy(from, to);
    }
    if (listing)
        closedir(listing);
    snprintf(to, sizeof to, "%s/%06u.synced", out, count);
    note = fopen(to, "w");
    if (note) {
        fputs(path[strlen(folder)] ? path + strlen(folder) + 1 : "", note);
        fclose(note);
    }
}

int fsync(int handle)
{
    int result = ((int (*)(int))dlsym(RTLD_NEXT, "fsync"))(handle);

    keep(handle);
    return result;
}

int fdatasync(int handle)
{
    int result = ((int (*)(int))dlsym(RTLD_NEXT, "fdatasync"))(handle);

    keep(handle);
    return result;
}
