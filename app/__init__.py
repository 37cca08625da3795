"""The page in the browser of this machine: files of tests in a project folder, read, fitted and exported by commands.

project    the folder: its files, the options of their commands, what was run
jobs       commands in processes of their own, which can be cancelled; warm is imported there first
guard      who may ask: this machine's browser, with the token of the address
command_forms  forms of the commands that take a parameter file
reading    the menus of a file's columns
messages   what commands print, with forms and fields in place of commands and options
server     the addresses of the page
"""
