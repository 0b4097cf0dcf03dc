function __flowsculpt_completions
    set -l typed (commandline -opc)
    for line in (env _FLOWSCULPT_COMPLETE=fish $typed "$(commandline -ct)" 2>/dev/null)
        if test "$line" = :files
            __fish_complete_path (commandline -ct)
        else
            printf '%s\n' $line
        end
    end
end
complete -c flowsculpt -f -a '(__flowsculpt_completions)'
