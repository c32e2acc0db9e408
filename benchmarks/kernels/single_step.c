/* Runs another process one instruction at a time and writes where each was: single_step PROCESS STEPS FOLDER.
   FOLDER/steps holds the instruction pointers, 8 bytes each; FOLDER/<first address> each piece of memory that holds code
   and belongs to no file: what a compiler made at run time. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/user.h>
#include <sys/wait.h>

static FILE *open_in(const char *folder, const char *name, const char *mode) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, mode);
    if (!file) {
        perror(path);
        exit(1);
    }
    return file;
}

int main(int count, char **words) {
    if (count != 4) return 2;
    pid_t process = atoi(words[1]);
    long steps = atol(words[2]);
    int status;
    if (ptrace(PTRACE_ATTACH, process, 0, 0) < 0 || waitpid(process, &status, 0) < 0) {
        perror("attach");
        return 1;
    }
    FILE *out = open_in(words[3], "steps", "wb");
    for (long i = 0; i < steps; i++) {
        struct user_regs_struct registers;
        if (ptrace(PTRACE_GETREGS, process, 0, &registers) < 0) break;
        fwrite(&registers.rip, 8, 1, out);
        ptrace(PTRACE_SINGLESTEP, process, 0, 0);
        waitpid(process, &status, 0);
        if (!WIFSTOPPED(status)) break;
    }
    fclose(out);

    char folder[64], line[4096];
    snprintf(folder, sizeof folder, "/proc/%d", process);
    FILE *maps = open_in(folder, "maps", "r"), *memory = open_in(folder, "mem", "rb");
    while (fgets(line, sizeof line, maps)) {
        unsigned long first, end, inode;
        char rights[8];
        if (sscanf(line, "%lx-%lx %7s %*s %*s %lu", &first, &end, rights, &inode) != 4) continue;
        if (rights[2] != 'x' || inode || strchr(line, '[')) continue;
        char *code = malloc(end - first), name[32];
        fseek(memory, (long)first, SEEK_SET);
        if (code && fread(code, 1, end - first, memory) == end - first) {
            snprintf(name, sizeof name, "%lx", first);
            FILE *piece = open_in(words[3], name, "wb");
            fwrite(code, 1, end - first, piece);
            fclose(piece);
        }
        free(code);
    }
    ptrace(PTRACE_DETACH, process, 0, 0);
    return 0;
}
